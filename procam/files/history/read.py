"""Reads a venue's history: runs, figures and their changes, and whether files are as they were written."""

from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from itertools import pairwise
from pathlib import Path

from procam.errors import InputError
from procam.files.csv_text import csv_text
from procam.files.history.figures import calibration_figures
from procam.files.history.store import file_digest, readable
from procam.files.versions import list_calibrations

MARKED_SIGMAS = 3.0  # a difference that is marked
Stated = tuple[float | None, float | None]  # value and standard error


@dataclass(frozen=True, slots=True)
class RunEntry:
    """A run as it was recorded.

    Attributes
    ----------
    started_at : ISO 8601, UTC. elapsed_s : None while it runs, and of one that was killed [s].
    outcome : done, refused (bad input or a full disk), failed (a device), stopped (by a signal), killed,
        or running.
    in_use : calibration that counted when it ended. written : names of those that it has written.
    """

    id: int
    command: str
    procam: str
    started_at: str
    elapsed_s: float | None
    outcome: str
    message: str
    in_use: str | None
    written: str | None


@dataclass(frozen=True, slots=True)
class FigureEntry:
    """A figure of a run or of a calibration; `sigma` is its standard error, `passed` its verdict."""

    run: int
    started_at: str
    command: str
    outcome: str
    calibration: str | None
    name: str
    value: float | None
    sigma: float | None
    unit: str
    op: str | None
    goal: float | None
    passed: int | None


def list_runs(venue_dir: Path) -> list[RunEntry]:
    """All runs, oldest first."""
    with readable(venue_dir) as db:
        if db is None:
            return []
        rows = db.execute(
            "SELECT id, command, procam, started_at, elapsed_s, outcome, message, in_use, "
            "(SELECT group_concat(c.name, ', ') FROM calibrations c WHERE c.run = runs.id) "
            "FROM runs ORDER BY id"
        )
        return [RunEntry(*row) for row in rows]


def list_figures(venue_dir: Path, calibration: str | None = None) -> list[FigureEntry]:
    """All figures, oldest first; or those of one calibration."""
    with readable(venue_dir) as db:
        if db is None:
            return []
        of = "" if calibration is None else "WHERE f.calibration = ?"
        rows = db.execute(
            "SELECT r.id, r.started_at, r.command, r.outcome, f.calibration, f.name, f.value, f.sigma, "
            f"f.unit, f.op, f.goal, f.passed FROM figures f JOIN runs r ON r.id = f.run {of} "
            "ORDER BY r.id, f.calibration, f.rowid",
            () if calibration is None else (calibration,),
        )
        return [FigureEntry(*row) for row in rows]


def figures_csv(venue_dir: Path) -> str:
    """All figures as CSV, a line for each."""
    columns = [field.name for field in fields(FigureEntry)]
    return csv_text([columns, *map(astuple, list_figures(venue_dir))])


def clock_went_back(runs: list[RunEntry]) -> list[int]:
    """Runs that by their times started before the one before them."""
    return [b.id for a, b in pairwise(runs) if b.started_at < a.started_at]


def changed_files(venue_dir: Path, directory: Path) -> Iterator[str]:
    """Files of a calibration that are not as procam wrote them, or are gone; by name."""
    inside = f"calibrations/{directory.name}"
    with readable(venue_dir) as db:
        if db is None:
            return
        rows = db.execute(
            "SELECT path, sha256, MAX(run) FROM files WHERE path GLOB ? GROUP BY path ORDER BY path",
            (f"{inside}/*",),
        ).fetchall()
    for name, digest, _ in rows:
        path = venue_dir / name
        if not path.is_file() or file_digest(path) != digest:
            yield name


def verify_unchanged(venue_dir: Path, directory: Path) -> None:
    """Refuse a calibration of a venue that was changed after procam wrote it.

    Raises
    ------
    InputError
        With the names of the files. A calibration that no run has recorded is not refused.
    """
    if directory.resolve().parent != venue_dir.resolve() / "calibrations":
        return  # a copy elsewhere: nothing is known of it
    if changed := list(changed_files(venue_dir, directory)):
        raise InputError(
            f"{venue_dir}: {', '.join(changed)} changed since procam wrote it; restore the file, or go "
            f"back to another calibration with `procam venue use {venue_dir}@N`"
        )


@dataclass(frozen=True, slots=True)
class FigureDifference:
    """A figure of calibrations a and b: values, b less a, that in standard errors; None where unknown."""

    name: str
    a: float | None
    b: float | None
    difference: float | None
    sigmas: float | None

    @property
    def is_marked(self) -> bool:
        """Whether the difference is more than noise explains."""
        return self.sigmas is not None and abs(self.sigmas) > MARKED_SIGMAS


def _stated_figures(venue_dir: Path, calibration: str) -> dict[str, Stated]:
    """Figures of a calibration by name: as the history has them, or its document until a run records it."""
    recorded = list_figures(venue_dir, calibration)
    if recorded:
        return {entry.name: (entry.value, entry.sigma) for entry in recorded}
    _, rows = calibration_figures(venue_dir / "calibrations" / calibration / "calibration.json")
    return {name: (value, sigma) for name, value, sigma, *_ in rows}


def figure_differences(venue_dir: Path, a: str, b: str) -> list[FigureDifference]:
    """Figures that two calibrations, a the earlier, have in common."""
    before, after = (_stated_figures(venue_dir, name) for name in (a, b))
    return [_difference(name, before[name], after[name]) for name in before if name in after]


def calibration_before(venue_dir: Path, name: str) -> str | None:
    """The newest earlier calibration of another capture session; None if there is none.

    One of the same session has the same measurements, and would show no change of the venue.
    """
    sessions = {
        path.name: calibration_figures(path / "calibration.json")[0]
        for path in list_calibrations(venue_dir)
    }
    earlier = [n for n in sessions if n < name and sessions[n] != sessions[name]]
    return earlier[-1] if earlier else None


def _difference(name: str, a: Stated, b: Stated) -> FigureDifference:
    off = None if a[0] is None or b[0] is None else b[0] - a[0]
    both = None if a[1] is None or b[1] is None else (a[1] ** 2 + b[1] ** 2) ** 0.5
    sigmas = off / both if off is not None and both else None
    return FigureDifference(name, a[0], b[0], off, sigmas)
