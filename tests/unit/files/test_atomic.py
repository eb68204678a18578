"""Writes that survive a kill."""

import os
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from procam.files import atomic


class Killed(Exception):
    """An interruption of a write."""


NO_PROCESS = 2**22 + 1  # Linux gives no such number


def _rewrite(path: Path, text: str) -> None:
    for _ in range(100):
        atomic.write_text(path, text)


def _listing(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


class TestReplacing:
    def test_new_content_appears_at_the_end(self, tmp_path: Path) -> None:
        path = tmp_path / "a" / "file.json"
        with atomic.replacing(path) as temporary:
            temporary.write_text("new")
            assert not path.exists()
            assert temporary.parent == path.parent and temporary.suffix == ".json"
        assert path.read_text() == "new"
        assert _listing(path.parent) == ["file.json"]

    def test_of_two_writers_at_once_the_later_is_kept(self, tmp_path: Path) -> None:
        path = tmp_path / "0031.png"
        with atomic.replacing(path) as one:
            one.write_text("later")
            with atomic.replacing(path) as other:
                other.write_text("earlier")
            assert path.read_text() == "earlier"
        assert path.read_text() == "later"
        assert _listing(tmp_path) == ["0031.png"]

    def test_two_processes_that_rewrite_one_file_all_the_time(self, tmp_path: Path) -> None:
        path, letters = tmp_path / "file.json", ["a" * 5000, "b" * 5000]
        with ProcessPoolExecutor(2) as pool:
            done = [pool.submit(_rewrite, path, text) for text in letters]
            while not all(each.done() for each in done):
                assert not path.exists() or path.read_text() in letters
            assert [each.result() for each in done] == [None, None]
        assert _listing(tmp_path) == ["file.json"]

    def test_a_temporary_file_that_vanishes_is_an_error(self, tmp_path: Path) -> None:
        path = tmp_path / "file.json"
        path.write_text("old")
        with pytest.raises(FileNotFoundError), atomic.replacing(path) as temporary:
            temporary.write_text("new")
            temporary.unlink()
        assert path.read_text() == "old"

    def test_an_exception_leaves_the_old_file_and_nothing_else(self, tmp_path: Path) -> None:
        path = tmp_path / "file.json"
        path.write_text("old")
        with pytest.raises(Killed), atomic.replacing(path) as temporary:
            temporary.write_text("half of the n")
            raise Killed
        assert path.read_text() == "old"
        assert _listing(tmp_path) == ["file.json"]

    def test_what_killed_runs_left_is_removed(self, tmp_path: Path) -> None:
        """Of this computer at once; of another, whose processes cannot be seen, after a day."""
        mine, other = atomic._this_computer(), "0badcafe"
        kept = {f".file.json.{mine}-{os.getpid()}-00000000.tmp.json", f".f.{other}-1-00000000.tmp"}
        left = f".file.json.{mine}-{NO_PROCESS}-00000000.tmp.json"
        for name in (*kept, left, ".mine.tmp"):
            (tmp_path / name).write_text("left behind")
        (folder := tmp_path / f".0001.{mine}-{NO_PROCESS}-00000000.tmp").mkdir()
        (folder / "stale").touch()
        old = tmp_path / f".0002.{other}-2-00000000.tmp"
        old.touch()
        os.utime(old, (0, time.time() - 1.1 * atomic.ABANDONED_S))
        atomic.write_text(tmp_path / "file.json", "new")
        assert set(_listing(tmp_path)) == {"file.json", ".mine.tmp", *kept}

    def test_a_link_in_the_place_of_the_file_is_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "secret").write_text("kept")
        (tmp_path / "file.json").symlink_to(tmp_path / "secret")
        atomic.write_text(tmp_path / "file.json", "new")
        assert (tmp_path / "secret").read_text() == "kept"
        assert (tmp_path / "file.json").read_text() == "new"


class TestReplacingDirectory:
    def test_appears_when_it_is_complete(self, tmp_path: Path) -> None:
        path = tmp_path / "calibrations" / "0001"
        with atomic.replacing_directory(path) as temporary:
            (temporary / "maps").mkdir()
            (temporary / "maps" / "dome.exr").write_bytes(b"x")
            assert not path.exists()
        assert (path / "maps" / "dome.exr").read_bytes() == b"x"
        assert _listing(path.parent) == ["0001"]

    def test_does_not_appear_after_an_exception(self, tmp_path: Path) -> None:
        path = tmp_path / "0001"
        with pytest.raises(Killed), atomic.replacing_directory(path) as temporary:
            (temporary / "one").write_text("1")
            raise Killed
        assert _listing(tmp_path) == []

    def test_never_overwrites_a_finished_one(self, tmp_path: Path) -> None:
        path = tmp_path / "0001"
        path.mkdir()
        (path / "kept").write_text("kept")
        with pytest.raises(OSError), atomic.replacing_directory(path) as temporary:
            (temporary / "other").write_text("other")
        assert _listing(path) == ["kept"]
        assert _listing(tmp_path) == ["0001"]


class TestPowerCut:
    """What is not flushed before it is renamed, nor renamed before its folder is flushed, can be lost."""

    @pytest.fixture
    def steps(self, monkeypatch: pytest.MonkeyPatch) -> list[str]:
        """Files that were flushed, and renames, in the order in which they reach the disk."""
        log: list[str] = []
        fsync, rename, replace = os.fsync, Path.rename, Path.replace

        def flushed(descriptor: int) -> None:
            fsync(descriptor)
            log.append(Path(f"/proc/self/fd/{descriptor}").readlink().name)

        def renamed(path: Path, target: Path) -> Path:
            log.append(f"{path.name} > {target.name}")
            return (rename if path.is_dir() else replace)(path, target)

        monkeypatch.setattr(os, "fsync", flushed)
        monkeypatch.setattr(Path, "rename", renamed)
        monkeypatch.setattr(Path, "replace", renamed)
        return log

    def test_a_file(self, tmp_path: Path, steps: list[str]) -> None:
        atomic.write_text(tmp_path / "a" / "plan.json", "{}")
        temporary, *others = steps
        assert temporary.startswith(".plan.json.") and temporary.endswith(".tmp.json")
        assert others == [f"{temporary} > plan.json", "a"]

    def test_a_folder(self, tmp_path: Path, steps: list[str]) -> None:
        with atomic.replacing_directory(tmp_path / "a" / "0001") as temporary:
            (temporary / "maps").mkdir()
            (temporary / "maps" / "dome.exr").write_bytes(b"x")
            (temporary / "calibration.json").write_text("{}")
        *inside, rename, parent = steps
        *files, temporary = inside
        assert sorted(files) == ["calibration.json", "dome.exr", "maps"]
        assert (rename, parent) == (f"{temporary} > 0001", "a")

    def test_a_line_of_a_log(self, tmp_path: Path, steps: list[str]) -> None:
        atomic.append_line(tmp_path / "index.jsonl", "one")
        assert steps == ["index.jsonl"]


class TestLog:
    def test_lines_come_back_in_order(self, tmp_path: Path) -> None:
        log = tmp_path / "index.jsonl"
        for line in ("one", "zwei ä", "three"):
            atomic.append_line(log, line)
        assert atomic.read_lines(log) == ["one", "zwei ä", "three"]

    @pytest.mark.parametrize("torn", [b"two", '{"x": "ä'.encode()[:-1]])
    def test_a_torn_last_line_is_dropped_by_the_reader(self, tmp_path: Path, torn: bytes) -> None:
        log = tmp_path / "index.jsonl"
        log.write_bytes(b"one\n" + torn)
        assert atomic.read_lines(log) == ["one"]

    @pytest.mark.parametrize("before", [b"", b"one\n"])
    def test_a_torn_last_line_is_cut_by_the_next_append(
        self, tmp_path: Path, before: bytes
    ) -> None:
        log = tmp_path / "index.jsonl"
        log.write_bytes(before + b"torn")
        atomic.append_line(log, "two")
        assert log.read_bytes() == before + b"two\n"

    def test_an_absent_log_has_no_lines(self, tmp_path: Path) -> None:
        assert atomic.read_lines(tmp_path / "none.jsonl") == []
