"""The history of a venue: what a run leaves there, cut off or not; damaged and foreign files."""

import json
import os
import shutil
import sqlite3
import subprocess
from pathlib import Path

import pytest

from procam.errors import DeviceError, FileFormatError, InputError
from procam.files.history import record
from procam.files.history.read import (
    changed_files,
    clock_went_back,
    figures_csv,
    list_figures,
    list_runs,
    verify_unchanged,
)
from procam.files.history.record import recorded
from procam.files.history.store import MIGRATIONS, NAME, SCHEMA, written
from procam.files.lock import locked
from procam.model.quality import Figure, Goal
from studies.history import DOCUMENT, trial

VENUE = """
[cameras.zenith]
size = [480, 360]
[projectors.south]
backend = "simulated"
size = [320, 200]
"""


def write_calibration(venue: Path, name: str = "0001", **changed: object) -> Path:
    folder = venue / "calibrations" / name
    (folder / "maps").mkdir(parents=True)
    (folder / "calibration.json").write_text(json.dumps(DOCUMENT | changed), "utf-8")
    (folder / "maps" / "dome.exr").write_bytes(b"map")
    return folder


def query(venue: Path, text: str) -> list[tuple[object, ...]]:
    with sqlite3.connect(venue / NAME) as db:
        found = db.execute(text).fetchall()
    db.close()
    return found


class TestRuns:
    def test_a_run_and_the_runs_within_it_are_one(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_text(VENUE)
        with recorded(tmp_path, "calibrate") as outer, recorded(tmp_path, "solve") as inner:
            assert inner is outer
            write_calibration(tmp_path)
        (run,) = list_runs(tmp_path)
        assert (run.command, run.outcome, run.written, run.in_use) == (
            *("calibrate", "done"),
            *("0001", "0001"),
        )
        assert run.elapsed_s is not None and run.elapsed_s >= 0
        assert query(tmp_path, "SELECT kind, name, backend, width, height FROM devices") == [
            ("camera", "zenith", "by-hand", 480, 360),
            ("projector", "south", "simulated", 320, 200),
        ]

    @pytest.mark.parametrize(
        ("error", "outcome"),
        [
            (InputError("no. Do this"), "refused"),
            (DeviceError("no answer"), "failed"),
            (OSError("disk"), "refused"),
            (KeyboardInterrupt(), "stopped"),
            (ZeroDivisionError("x"), "failed"),
        ],
    )
    def test_how_it_ended(self, error: BaseException, outcome: str, tmp_path: Path) -> None:
        with pytest.raises(type(error)), recorded(tmp_path, "verify"):
            raise error
        (run,) = list_runs(tmp_path)
        assert (run.outcome, run.message) == (outcome, str(error) or "KeyboardInterrupt")

    def test_a_killed_run_is_found_by_the_next_and_so_is_what_it_wrote(
        self, tmp_path: Path
    ) -> None:
        child = os.fork()
        if not child:
            with recorded(tmp_path, "capture") as run:
                run.measured({"lost": Figure(1.0, "px")})
                write_calibration(tmp_path)
                os.kill(os.getpid(), 9)
        os.waitpid(child, 0)
        assert [run.outcome for run in list_runs(tmp_path)] == ["running"]
        with recorded(tmp_path, "verify"):
            pass
        killed, later = list_runs(tmp_path)
        assert (killed.outcome, killed.elapsed_s) == ("killed", None)
        assert later.written == "0001"

    def test_another_process_is_refused_by_name_and_leaves_no_run(self, tmp_path: Path) -> None:
        ready, go = os.pipe(), os.pipe()
        child = os.fork()
        if not child:
            with locked(tmp_path, "recalibrate"):
                os.write(ready[1], b"1")
                os.read(go[0], 1)
            os._exit(0)
        os.read(ready[0], 1)
        with pytest.raises(InputError, match="`procam recalibrate`"), recorded(tmp_path, "verify"):
            pass
        os.write(go[1], b"1")
        os.waitpid(child, 0)
        assert list_runs(tmp_path) == []

    def test_a_clock_that_went_back_is_noticed_and_the_order_stays(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        real = record.datetime

        class Clock:
            year = 2027

            @classmethod
            def now(cls, zone: object) -> object:
                return real(cls.year, 1, 1, tzinfo=zone)  # type: ignore[arg-type]

        monkeypatch.setattr(record, "datetime", Clock)
        for Clock.year in (2027, 2026, 2028):
            with recorded(tmp_path, f"verify-{Clock.year}"):
                pass
        runs = list_runs(tmp_path)
        assert [run.command for run in runs] == ["verify-2027", "verify-2026", "verify-2028"]
        assert clock_went_back(runs) == [2]

    def test_each_commit_is_flushed_to_disk(self, tmp_path: Path) -> None:
        with written(tmp_path) as db:
            flushed, journal = (
                db.execute(f"PRAGMA {name}").fetchone()[0]
                for name in ("synchronous", "journal_mode")
            )
        assert (flushed, journal) == (2, "wal")  # FULL


class TestFigures:
    def test_values_sigmas_goals_and_lists(self, tmp_path: Path) -> None:
        with recorded(tmp_path, "verify") as run:
            run.measured(
                {
                    "moved": Figure(0.4, "px", Goal("<=", 0.25), sigma=0.05),
                    "light": Figure([0.9, 1.0, 1.1], "-", sigma=[0.01, 0.02, 0.03]),
                    "residual": Figure([1.0, 0.5], "rel"),
                    "sound": Figure(True, "-", Goal("==", True)),
                    "unknown": Figure(float("nan"), "px", Goal("<=", 1.0)),
                }
            )
        rows = {
            f.name: (f.value, f.sigma, f.unit, f.op, f.goal, f.passed)
            for f in list_figures(tmp_path)
        }
        assert rows == {
            "moved": (0.4, 0.05, "px", "<=", 0.25, 0),
            "light.R": (0.9, 0.01, "-", None, None, None),
            "light.G": (1.0, 0.02, "-", None, None, None),
            "light.B": (1.1, 0.03, "-", None, None, None),
            "residual.0": (1.0, None, "rel", None, None, None),
            "residual.1": (0.5, None, "rel", None, None, None),
            "sound": (1.0, None, "-", "==", 1.0, 1),
            "unknown": (None, None, "px", "<=", 1.0, 0),
        }

    def test_those_of_a_calibration_come_from_its_document(self, tmp_path: Path) -> None:
        states = {"full": {"feedback": {"value": [0.2, 0.2, 0.2], "sigma": [0.01, 0.01, 0.01]}}}
        matrix = [[4.0, 0, 0], [0, 2.0, 0], [0, 0, 1.0]]
        write_calibration(tmp_path, states=states, content_from_camera=matrix)
        with recorded(tmp_path, "solve"):
            pass
        found = {f.name: (f.value, f.sigma) for f in list_figures(tmp_path, "0001")}
        assert found["feedback.G"] == (0.3, 0.01)
        assert found["feedback.full.B"] == (0.2, 0.01)
        assert [found[f"white_in_camera.{c}"][0] for c in "RGB"] == [0.25, 0.5, 1.0]
        assert (
            figures_csv(tmp_path)
            .splitlines()[1]
            .endswith("solve,done,0001,feedback.R,0.3,0.01,-,,,")
        )

    def test_a_damaged_document_stops_no_run(self, tmp_path: Path) -> None:
        folder = tmp_path / "calibrations" / "0001"
        folder.mkdir(parents=True)
        (folder / "calibration.json").write_bytes(b"{")
        with recorded(tmp_path, "solve"):
            pass
        assert list_figures(tmp_path) == []


class TestFiles:
    def test_a_calibration_changed_by_hand_is_refused_by_the_names_of_its_files(
        self, tmp_path: Path
    ) -> None:
        folder = write_calibration(tmp_path)
        with recorded(tmp_path, "solve"):
            pass
        verify_unchanged(tmp_path, folder)
        (folder / "maps" / "dome.exr").write_bytes(b"mop")
        assert list(changed_files(tmp_path, folder)) == ["calibrations/0001/maps/dome.exr"]
        with pytest.raises(InputError, match=r"dome\.exr changed since .*procam venue use"):
            verify_unchanged(tmp_path, folder)
        with recorded(tmp_path, "solve"):  # which does not take the change for its own
            pass
        with pytest.raises(InputError):
            verify_unchanged(Path(os.path.relpath(tmp_path)), folder)
        (folder / "maps" / "dome.exr").unlink()
        assert list(changed_files(tmp_path, folder)) == ["calibrations/0001/maps/dome.exr"]

    def test_one_that_was_deleted_and_made_again_is_the_new_one(self, tmp_path: Path) -> None:
        folder = write_calibration(tmp_path)
        with recorded(tmp_path, "solve"):
            pass
        shutil.rmtree(folder)
        with recorded(tmp_path, "solve"):
            write_calibration(tmp_path, albedo={"value": [0.4] * 3, "sigma": [0.01] * 3})
        verify_unchanged(tmp_path, folder)
        assert [run.written for run in list_runs(tmp_path)] == [None, "0001"]
        found = {f.name: f.value for f in list_figures(tmp_path, "0001")}
        assert found["albedo.R"] == 0.4
        with recorded(tmp_path, "verify"):
            (folder / "calibration.json").write_bytes(b"{}")
        with pytest.raises(InputError):
            verify_unchanged(tmp_path, folder)

    def test_a_copy_elsewhere_is_not_judged(self, tmp_path: Path) -> None:
        write_calibration(tmp_path)
        with recorded(tmp_path, "solve"):
            pass
        copy = shutil.copytree(tmp_path / "calibrations" / "0001", tmp_path / "copy")
        (copy / "calibration.json").write_bytes(b"{}")
        verify_unchanged(tmp_path, copy)

    def test_logs_of_sessions_are_recorded_when_they_change(self, tmp_path: Path) -> None:
        log = tmp_path / "sessions" / "0001" / "captures" / "zenith" / "index.jsonl"
        log.parent.mkdir(parents=True)
        for text in ("a\n", "a\n", "a\nb\n"):
            log.write_text(text)
            with recorded(tmp_path, "capture"):
                pass
        assert query(tmp_path, "SELECT run, bytes FROM files ORDER BY run") == [(1, 2), (3, 4)]


class TestRefused:
    def test_a_later_schema_is_refused_and_left_as_it_is(self, tmp_path: Path) -> None:
        with recorded(tmp_path, "solve"):
            pass
        query(tmp_path, f"PRAGMA user_version = {SCHEMA + 1}")
        before = (tmp_path / NAME).read_bytes()
        for read in (lambda: list_runs(tmp_path), lambda: recorded(tmp_path, "x").__enter__()):
            with pytest.raises(FileFormatError, match="later version of procam"):
                read()
        assert (tmp_path / NAME).read_bytes() == before

    @pytest.mark.parametrize("content", [b"no database" * 100, b"SQLite format 3\0" + bytes(5000)])
    def test_a_damaged_file_is_named_and_left_as_it_is(
        self, content: bytes, tmp_path: Path
    ) -> None:
        (tmp_path / NAME).write_bytes(content)
        for read in (lambda: list_runs(tmp_path), lambda: recorded(tmp_path, "x").__enter__()):
            with pytest.raises(FileFormatError, match=r"is damaged .* restore it from a backup"):
                read()
        assert (tmp_path / NAME).read_bytes() == content

    def test_ctrl_c_while_rows_are_checked_is_no_damage(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """SQLite calls procam's checksum, and drops what stops it."""
        with recorded(tmp_path, "solve"):
            pass

        def stopped(_: bytes) -> int:
            raise KeyboardInterrupt

        with monkeypatch.context() as patched:
            patched.setattr("procam.files.history.soundness.zlib.crc32", stopped)
            with pytest.raises(KeyboardInterrupt):
                list_runs(tmp_path)
        assert [run.outcome for run in list_runs(tmp_path)] == ["done"]

    @pytest.mark.parametrize(
        "change",
        [
            "PRAGMA user_version = 0",
            "PRAGMA user_version = -3",
            "DROP TABLE figures",
            "ALTER TABLE runs RENAME COLUMN message TO text",
            "DROP INDEX figures_of_run",
            "CREATE TRIGGER t AFTER INSERT ON runs BEGIN DELETE FROM figures; END",
            "UPDATE figures SET value = 0.5",
            "UPDATE figures SET checksum = ''",
            "UPDATE runs SET message = CAST(x'ff00fe' AS TEXT)",
            "UPDATE devices SET width = 3",
            "UPDATE calibrations SET session = '0002'",
            "UPDATE files SET sha256 = ''",
        ],
    )
    def test_what_procam_has_not_written_is_refused_and_left_as_it_is(
        self, change: str, tmp_path: Path
    ) -> None:
        (tmp_path / "venue.toml").write_text(VENUE)
        with recorded(tmp_path, "solve") as run:
            write_calibration(tmp_path)
            run.measured({"moved": Figure(0.4, "px")})
        query(tmp_path, change)
        before = (tmp_path / NAME).read_bytes()
        for read in (
            lambda: list_runs(tmp_path),
            lambda: list_figures(tmp_path),
            lambda: list(changed_files(tmp_path, tmp_path / "calibrations" / "0001")),
            lambda: recorded(tmp_path, "x").__enter__(),
        ):
            with pytest.raises(FileFormatError, match=r"is damaged .* restore it from a backup"):
                read()
        assert (tmp_path / NAME).read_bytes() == before

    @pytest.mark.parametrize("time", ["yesterday", "", "2026-01-01", "0001-01-01T00:00:00+14:00"])
    def test_times_that_cannot_be_shown_are_refused_whoever_wrote_them(
        self, time: str, tmp_path: Path
    ) -> None:
        with recorded(tmp_path, "solve"):
            pass
        with written(tmp_path) as db:
            db.execute("UPDATE runs SET started_at = ?, checksum = ''", (time,))
        with pytest.raises(FileFormatError, match="row 1 of runs"):
            list_runs(tmp_path)

    def test_a_file_of_the_first_version_is_read_and_gets_checksums(self, tmp_path: Path) -> None:
        with sqlite3.connect(tmp_path / NAME) as db:
            db.executescript(MIGRATIONS[0])
            started = "2026-01-01T00:00:00+00:00"
            db.execute(
                "INSERT INTO runs VALUES (1, 'solve', '0.1', ?, 1, 'done', '', NULL)", (started,)
            )
            db.execute("PRAGMA user_version = 1")
        db.close()
        assert [run.command for run in list_runs(tmp_path)] == ["solve"]
        with recorded(tmp_path, "verify"):
            pass
        assert [run.command for run in list_runs(tmp_path)] == ["solve", "verify"]
        assert all(query(tmp_path, "SELECT checksum <> '' FROM runs"))
        query(tmp_path, "UPDATE runs SET elapsed_s = 2")
        with pytest.raises(FileFormatError, match="row 1 of runs differs"):
            list_runs(tmp_path)

    def test_words_that_are_no_text_are_written_out(self, tmp_path: Path) -> None:
        (tmp_path / "venue.toml").write_text(
            '[cameras.a]\nsize = ["x", 1]\n[cameras.b]\nsize = [99999999999999999999, 1]\n'
        )
        quality = {"a\ud800": {"value": 1.0, "unit": "\ud800", "goal": {"op": ["<"], "value": 1}}}
        write_calibration(tmp_path, quality=quality)
        with pytest.raises(InputError), recorded(tmp_path, "solve"):
            raise InputError("no \udcff here")
        (run,) = list_runs(tmp_path)
        assert run.message == "no \\udcff here"
        assert "a\\ud800" in {figure.name for figure in list_figures(tmp_path)}

    @pytest.mark.skipif(os.geteuid() != 0, reason="root mounts it")
    def test_it_is_read_from_a_disk_that_is_mounted_to_be_read(self, tmp_path: Path) -> None:
        with recorded(tmp_path, "solve") as run:
            run.measured({"moved": Figure(0.4, "px")})
        mount = ("mount", "--bind", "-o", "ro", tmp_path, tmp_path)
        if subprocess.run(mount, check=False).returncode:
            pytest.skip("nothing can be mounted here")
        try:
            assert [run.command for run in list_runs(tmp_path)] == ["solve"]
            assert [figure.value for figure in list_figures(tmp_path)] == [0.4]
            with pytest.raises(OSError, match="Read-only"), recorded(tmp_path, "solve"):
                pass
        finally:
            subprocess.run(("umount", tmp_path), check=True)

    def test_another_program_that_holds_it(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        with recorded(tmp_path, "solve"):
            pass
        monkeypatch.setattr("procam.files.history.store.BUSY_S", 0.01)
        other = sqlite3.connect(tmp_path / NAME, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(FileFormatError, match="in use by another program"):
            recorded(tmp_path, "x").__enter__()
        other.close()


@pytest.mark.parametrize(
    ("kind", "share"), [("killed", 0.3), ("killed", 0.9), ("file limit", 0.05), ("file limit", 0.5)]
)
def test_cut_off_anywhere_nothing_is_lost_or_half_written(
    kind: str, share: float, tmp_path: Path
) -> None:
    trial(tmp_path / "venue", kind, share)  # type: ignore[arg-type]
