"""Writes that survive a kill."""

import os
from pathlib import Path

import pytest

from procam.files import atomic


class Killed(Exception):
    """An interruption of a write."""


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

    @pytest.mark.parametrize("old", [None, "old"])
    def test_of_two_writers_at_once_one_is_kept(self, tmp_path: Path, old: str | None) -> None:
        path = tmp_path / "0031.png"
        if old:
            path.write_text(old)
        with atomic.replacing(path) as one:
            one.write_text("whole")
            with atomic.replacing(path) as other:
                other.write_text("whole")
        assert path.read_text() == "whole"
        assert _listing(tmp_path) == ["0031.png"]

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

    def test_files_left_by_a_killed_run_do_no_harm(self, tmp_path: Path) -> None:
        path = tmp_path / "file.json"
        with pytest.raises(Killed), atomic.replacing(path) as temporary:
            name = temporary.name
            raise Killed
        (tmp_path / name).write_text("left behind")
        atomic.write_text(path, "new")
        assert path.read_text() == "new"
        assert _listing(tmp_path) == ["file.json"]

    def test_a_link_in_the_place_of_the_temporary_file_is_not_followed(
        self, tmp_path: Path
    ) -> None:
        with pytest.raises(Killed), atomic.replacing(tmp_path / "file.json") as temporary:
            raise Killed
        (tmp_path / "secret").write_text("kept")
        temporary.symlink_to(tmp_path / "secret")
        atomic.write_text(tmp_path / "file.json", "new")
        assert (tmp_path / "secret").read_text() == "kept"
        assert (tmp_path / "file.json").read_text() == "new"
        assert not (tmp_path / "file.json").is_symlink()

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

    def test_starts_clean_after_a_killed_run(self, tmp_path: Path) -> None:
        (tmp_path / ".0001.tmp").mkdir()
        (tmp_path / ".0001.tmp" / "stale").write_text("stale")
        with atomic.replacing_directory(tmp_path / "0001") as temporary:
            (temporary / "fresh").write_text("fresh")
        assert _listing(tmp_path / "0001") == ["fresh"]


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
        temporary = ".plan.json.tmp.json"
        assert steps == [temporary, f"{temporary} > plan.json", "a"]

    def test_a_folder(self, tmp_path: Path, steps: list[str]) -> None:
        with atomic.replacing_directory(tmp_path / "a" / "0001") as temporary:
            (temporary / "maps").mkdir()
            (temporary / "maps" / "dome.exr").write_bytes(b"x")
            (temporary / "calibration.json").write_text("{}")
        *inside, rename, parent = steps
        assert sorted(inside) == [".0001.tmp", "calibration.json", "dome.exr", "maps"]
        assert (inside[-1], rename, parent) == (".0001.tmp", ".0001.tmp > 0001", "a")

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
