"""Records the runs of a venue: how each one ended, with which devices, what it measured and wrote."""

import sqlite3
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from procam.errors import DeviceError, InputError, ProcamError
from procam.files.history.figures import Row, calibration_figures, figure_rows
from procam.files.history.store import file_digest, storable, written
from procam.files.lock import locked
from procam.files.toml import read_toml
from procam.files.versions import list_calibrations, name_in_use
from procam.model.quality import Figure

RUNNING, DONE, STOPPED = "running", "done", "stopped"
KILLED, REFUSED, FAILED = "killed", "refused", "failed"
MOST_PIXELS = 2**31  # along an edge; SQLite refuses larger numbers than 2**63
_open: dict[Path, "Run"] = {}  # of this process, by venue


@dataclass
class Run:
    """A run that is being recorded; its figures are written when it ends.

    Attributes
    ----------
    id : its number in the venue. there : names of the calibrations when it began.
    message : one sentence for the list of runs.
    """

    id: int
    there: frozenset[str] = frozenset()
    message: str = ""
    _figures: list[Row] = field(default_factory=list)

    def measured(self, figures: Mapping[str, Figure]) -> None:
        """Add figures by name."""
        for name, figure in figures.items():
            self._figures += figure_rows(name, figure.as_dict())


@contextmanager
def recorded(venue_dir: Path, command: str) -> Iterator[Run]:
    """Hold a venue's folder against other processes, and record the run; within another it is that run.

    `command` is what the refusal of another process calls this one, such as "capture". A run whose process
    was killed is found by the next one. So are calibrations that were written by then.

    Raises
    ------
    InputError
        Another process holds the venue.
    FileFormatError, OSError
        The history cannot be written; nothing has been started yet, or all results are on disk.
    """
    folder = venue_dir.resolve()
    if folder in _open:
        yield _open[folder]
        return
    with locked(venue_dir, command):
        there = frozenset(path.name for path in list_calibrations(venue_dir))
        run, started_s = Run(_begin(venue_dir, command), there), time.monotonic()
        _open[folder] = run
        try:
            yield run
        except BaseException as error:
            run.message = run.message or _first_line(error)
            with suppress(ProcamError, OSError, sqlite3.Error):  # the first error is what counts
                _end(venue_dir, run, _outcome(error), time.monotonic() - started_s)
            raise
        else:
            _end(venue_dir, run, DONE, time.monotonic() - started_s)
        finally:
            del _open[folder]


def _begin(venue_dir: Path, command: str) -> int:
    with written(venue_dir) as db:
        db.execute(
            "UPDATE runs SET outcome = ?, checksum = '' WHERE outcome = ?", (KILLED, RUNNING)
        )
        added = db.execute(
            "INSERT INTO runs (command, procam, started_at, outcome, message) VALUES (?, ?, ?, ?, '')",
            (command, version("procam"), datetime.now(UTC).isoformat(timespec="seconds"), RUNNING),
        )
        run = added.lastrowid
        assert run is not None
        db.executemany(
            "INSERT INTO devices VALUES (?, ?, ?, ?, ?, ?, '')",
            [(run, *device) for device in _devices(venue_dir)],
        )
        _adopt(venue_dir, db, run)
        return run


def _end(venue_dir: Path, run: Run, outcome: str, elapsed_s: float) -> None:
    with written(venue_dir) as db:
        _adopt(venue_dir, db, run.id, run.there)
        _add_figures(db, run.id, None, run._figures)
        db.execute(
            "UPDATE runs SET outcome = ?, elapsed_s = ?, message = ?, in_use = ?, checksum = '' WHERE id = ?",
            (outcome, round(elapsed_s, 3), run.message, name_in_use(venue_dir), run.id),
        )


def _adopt(
    venue_dir: Path, db: sqlite3.Connection, run: int, there: frozenset[str] | None = None
) -> None:
    """Record calibrations, and files of sessions, that no run has recorded yet.

    Of the calibrations `there` when the run began, or of all; others it has written itself, also under the
    name of one that was deleted.
    """
    known = {name for (name,) in db.execute("SELECT name FROM calibrations")}
    known = known if there is None else known & there
    for directory in list_calibrations(venue_dir):
        if directory.name in known:
            continue
        session, rows = calibration_figures(directory / "calibration.json")
        values = (directory.name, run, session)
        db.execute(
            "INSERT INTO calibrations VALUES (?, ?, ?, '') ON CONFLICT (name) DO UPDATE "
            "SET run = excluded.run, session = excluded.session, checksum = ''",
            values,
        )
        _add_figures(db, run, directory.name, rows)
        _add_files(venue_dir, db, run, sorted(p for p in directory.rglob("*") if p.is_file()))
    logs = venue_dir.glob("sessions/*/captures/*/index.jsonl")
    _add_files(venue_dir, db, run, sorted([*venue_dir.glob("sessions/*/plan.json"), *logs]))


def _add_files(venue_dir: Path, db: sqlite3.Connection, run: int, paths: list[Path]) -> None:
    """Record hashes of files, where they are not what was recorded last."""
    for path in paths:
        name, digest = storable(path.relative_to(venue_dir).as_posix()), file_digest(path)
        last = db.execute(
            "SELECT sha256 FROM files WHERE path = ? ORDER BY run DESC LIMIT 1", (name,)
        ).fetchone()
        if last is None or last[0] != digest:
            db.execute(
                "INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?, '')",
                (run, name, digest, path.stat().st_size),
            )


def _add_figures(
    db: sqlite3.Connection, run: int, calibration: str | None, rows: list[Row]
) -> None:
    db.executemany(
        "INSERT INTO figures VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, '')",
        [(run, calibration, *row) for row in rows],
    )


def _devices(venue_dir: Path) -> Iterator[tuple[str, str, str, int | None, int | None]]:
    """Kind, name, backend, width and height of what venue.toml lists; nothing if it cannot be read."""
    table: Mapping[str, object] = {}
    with suppress(InputError, OSError):  # which the run itself refuses in its own words
        table = read_toml(venue_dir / "venue.toml")
    for kind in ("camera", "projector"):
        entries = table.get(f"{kind}s")
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            if isinstance(entry, dict):
                backend = storable(entry.get("backend", "by-hand"))
                yield kind, storable(name), backend, *_size(entry.get("size"))


def _size(size: object) -> tuple[int | None, int | None]:
    """Width and height, if they are numbers of pixels."""
    pair = size if isinstance(size, list) and len(size) == 2 else [None]
    if all(type(n) is int and abs(n) < MOST_PIXELS for n in pair):
        return pair[0], pair[1]
    return None, None


def _outcome(error: BaseException) -> str:
    if isinstance(error, DeviceError):
        return FAILED
    if isinstance(error, (ProcamError, OSError)):
        return REFUSED
    return FAILED if isinstance(error, Exception) else STOPPED


def _first_line(error: BaseException) -> str:
    lines = str(error).splitlines() or [type(error).__name__]
    return storable(lines[0])
