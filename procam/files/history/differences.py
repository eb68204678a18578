"""Differences between the figures of two calibrations of a venue."""

from dataclasses import dataclass
from pathlib import Path

from procam.files.history.figures import calibration_figures
from procam.files.history.read import list_figures
from procam.files.versions import list_calibrations

MARKED_SIGMAS = 3.0  # a difference that is marked
Stated = tuple[float | None, float | None]  # value and standard error


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


def stated_figures(venue_dir: Path, calibration: str) -> dict[str, Stated]:
    """Figures of a calibration by name: as the history has them, or its document until a run records it."""
    recorded = list_figures(venue_dir, calibration)
    if recorded:
        return {entry.name: (entry.value, entry.sigma) for entry in recorded}
    _, rows = calibration_figures(venue_dir / "calibrations" / calibration / "calibration.json")
    return {name: (value, sigma) for name, value, sigma, *_ in rows}


def figure_differences(venue_dir: Path, a: str, b: str) -> list[FigureDifference]:
    """Figures that two calibrations, a the earlier, have in common."""
    before, after = (stated_figures(venue_dir, name) for name in (a, b))
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
