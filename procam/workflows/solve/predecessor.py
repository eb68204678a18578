"""Compares a new calibration of a venue with the one in use, which it replaces if they can both be right."""

from collections.abc import Iterator
from pathlib import Path

from procam.compensate.predicted_picture import thinned
from procam.errors import CalibrationError
from procam.files.calibration import load_calibration
from procam.files.versions import use_calibration
from procam.memory import return_buffers
from procam.model.calibration import Calibration
from procam.workflows.comparison import compare

CONTRADICTION = ("exchanged", "differ")  # verdicts that no change to a rig explains


def compare_with_predecessor(venue_dir: Path, before: Path | None, new: Path) -> list[str]:
    """Compare a new calibration with the one used before it; one that contradicts it is not used.

    Of both as many pixels are read as show the picture: six large panels take half a gigabyte.

    Returns what to tell the crew: nothing for the first, and for one that agrees and has all that the other
    had. What contradicts another rig is no news.
    """
    if before is None:
        return []
    return_buffers()  # of the solve
    old, calibration = (load_calibration(each, keep=thinned) for each in (before, new))
    return [*_compared(venue_dir, (before, old), new, calibration), *_missing(before.name, old)]


def _missing(name: str, old: Calibration) -> Iterator[str]:
    """What the calibration before had been given since its solve, and a new solve cannot know."""
    if old.states:
        states = ", ".join(old.states)
        yield f"venue states of {name} are not in it: {states}; measure them again: procam state"
    if old.absolute:
        yield f"{name} knew its white in cd/m2 by a hand meter, and this one does not: procam meter"


def _compared(
    venue_dir: Path, one_before: tuple[Path, Calibration], new: Path, calibration: Calibration
) -> list[str]:
    before, old = one_before
    if _panels(old) != _panels(calibration):
        return []
    try:
        verdict = compare(old, calibration).verdict
    except CalibrationError:  # they share too little to be compared
        return []
    if verdict.kind in CONTRADICTION:
        use_calibration(venue_dir, before)
        return [
            f"{new.name} contradicts {before.name}, which stays in use: {verdict.text}. If the new one is "
            f"right, run: procam venue use {venue_dir}@{int(new.name)}"
        ]
    use_calibration(venue_dir, new)
    return [] if verdict.sound else [f"unlike {before.name}: {verdict.text}"]


def _panels(calibration: Calibration) -> dict[str, tuple[int, int]]:
    return {name: p.model.size for name, p in calibration.projectors.items()}
