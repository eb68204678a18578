"""Finds what is worse after a repair than before: notes, the fit, and how much a projector lights."""

import math
import re
from collections.abc import Sequence

import numpy as np

from procam.arrays import Array
from procam.estimate.calibration import COVERED
from procam.estimate.light.blend import common_white
from procam.model.calibration import Calibration
from procam.model.photometry import CERTAIN
from procam.model.provenance import Note
from procam.model.transport import Measured
from procam.workflows.recalibrate.one_projector import Repaired

WORSE, LEAST_RESIDUAL_PX = 3.0, 0.05
MOST_LOST = 0.1  # of the lit share of a panel: a projector that is nudged by degrees keeps more
WHITE_LOST = 0.02  # of the common white; a common white is known to a percent
DARK = 1e-3  # falloff beyond the lit part, where it may be 0
LEAST_ROOM = 1e-4  # of white: a twentieth of black
MUCH_MORE = 2.0  # times the amount of before, and as much as is noted
_DIGITS = re.compile(r"[\d.]+")


def new_notes(old: Calibration, notes: Sequence[Note]) -> list[Note]:
    """Notes of new photographs that the calibration does not have, or has with a much smaller amount.

    Each says that a figure is wrong or may be, and the calibration that is to be repaired is not.
    """
    known = old.provenance.notes
    return [note for note in notes if not any(_is_known(note, each) for each in known)]


def _is_known(note: Note, before: Note) -> bool:
    """Whether a note is of the same kind, device and sign as one before, and at most about twice as large."""
    if not before.code:  # of a calibration of before notes had one
        words = (_DIGITS.sub("", each.text) for each in (note, before))
        return note.subject == before.subject and next(words) == next(words)
    same = (note.code, note.subject) == (before.code, before.subject)
    along = note.amount * math.copysign(1, before.amount)
    return same and -1 <= along <= MUCH_MORE * abs(before.amount) + 1


def worse_notes(old: Calibration, repaired: Repaired, name: str, ambient: Measured) -> list[str]:
    """Notes if a projector fits much worse than the rig did, or covers much less than before.

    Also if its dark is not that of the verification just before, by which the room's light is `ambient`
    more than in the session [rel].
    """
    notes = list[str]()
    rise = float(np.mean(repaired.room - ambient.value))
    if abs(rise) > max(LEAST_ROOM, CERTAIN * float(np.mean(ambient.sigma))):
        notes.append(
            f"the room's own light changed by {rise:+.3%} of white between the verification and the dark "
            f"photograph of {name}, whose black is wrong by as much. Keep lamps and doors as they are"
        )
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


def white_notes(old: Calibration, new: Calibration) -> list[str]:
    """A note if repaired projectors cannot show the white that all the others keep."""
    before, after = (_reachable_white(each) for each in (old, new))
    lost = 1 - float((after / before).min())
    if lost < WHITE_LOST:
        return []
    return [
        f"the dimmest place reaches {1 - lost:.0%} of the white of the calibration before, which all "
        "projectors keep: a small white object is dimmer there. A whole calibration (procam calibrate) "
        "takes a white that every place reaches"
    ]


def _reachable_white(calibration: Calibration) -> Array:
    """White (3,) that every lit direction can show [rel]."""
    maps = calibration.maps
    full = maps.hi if maps.falloff is None else maps.hi / np.maximum(maps.falloff, DARK)[..., None]
    return common_white(full, maps.coverage > COVERED)
