"""What is worse after a repair than before: notes, the fit, and how much a projector lights."""

import re
from collections.abc import Sequence

from procam.model.calibration import Calibration
from procam.workflows.recalibrate.one_projector import Repaired

WORSE, LEAST_RESIDUAL_PX = 3.0, 0.05
MOST_LOST = 0.1  # of the lit share of a panel: a projector that is nudged by degrees keeps more
# a number of a note, and not of a device's name
_NUMBER = re.compile(
    r"(?<![\w.-])(?<!projector )(?<!camera )[+-]?(\d+(?:\.\d+)?)(?:e[+-]?\d+)?(%?)"
)
MUCH_MORE, LEAST_MORE = 2.0, 1.0  # times a percentage of before, and percent beyond that


def new_notes(old: Calibration, notes: Sequence[str]) -> list[str]:
    """Notes of new photographs that the calibration did not have, or with much smaller percentages.

    Each says that a figure is wrong or may be, and the calibration that is to be repaired is not.
    """
    known = [str(note) for note in old.provenance.get("notes", ())]
    return [note for note in notes if not any(_is_known(note, each) for each in known)]


def _is_known(note: str, before: str) -> bool:
    """Whether a note says what one before said, of the same device and of no much larger share."""
    if _NUMBER.sub("", note) != _NUMBER.sub("", before):
        return False
    both = zip(_NUMBER.findall(note), _NUMBER.findall(before), strict=True)
    return all(
        float(now) <= MUCH_MORE * float(then) + LEAST_MORE
        for (now, percent), (then, _) in both
        if percent
    )


def worse_notes(old: Calibration, repaired: Repaired, name: str) -> list[str]:
    """Notes if a projector fits much worse than the rig did, or covers much less than before."""
    notes = list[str]()
    before = old.quality.get("geometry_residual_rms_px")
    limit = WORSE * (float(before.value) if before and isinstance(before.value, float) else 0.0)
    if repaired.residual_px > max(limit, LEAST_RESIDUAL_PX):
        notes.append(
            f"{name} fits by {repaired.residual_px:.2f} px, and the calibration before by "
            f"{limit / WORSE:.2f}. Did something move while it was photographed?"
        )
    was, now = (float(c.projectors[name].surface.valid.mean()) for c in (old, repaired.calibration))
    if now < (1 - MOST_LOST) * was:
        notes.append(
            f"{now:.0%} of the panel of {name} light the screen, and {was:.0%} did before. Does "
            "something stand before it or before the camera, or does its picture miss the screen?"
        )
    return notes
