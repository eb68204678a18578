"""Whether a projector shows every pixel it is sent, judged from a decoded map."""

import numpy as np

from procam.arrays import FloatArray
from procam.estimate.structured_light.codes import AXES, NAMES, Code
from procam.model.correspondence import CorrespondenceMap

PIXELS_PER_LINE = (
    30  # camera pixels that columns have on average, for a missing one to be significant
)
MAX_STEP_PX = 0.7  # projector pixels per camera pixel: a coarser camera misses columns itself
UNSEEN_SHARE = 0.03  # of the columns or rows between seen ones


def panel_notes(code: Code, found: CorrespondenceMap) -> list[str]:
    """Notes on columns and rows that are never seen between others that are.

    A projector that scales its input (keystone correction, another resolution) drops some, so that
    panel and screen do not match one to one. Only codes that identify single columns show it.
    """
    if code.has_waves or max(code.x.resolution_px, code.y.resolution_px) > 1:
        return []
    shares = {}
    for i, axis in enumerate(AXES):
        positions = found.projector_xy[..., i]
        if _step_px(positions) > MAX_STEP_PX:
            continue
        unseen = unseen_share(positions[found.valid])
        if unseen > UNSEEN_SHARE:
            shares[NAMES[axis]] = unseen
    if not shares:
        return []
    what = " and ".join(f"{share:.0%} of the {name}" for name, share in shares.items())
    return [
        f"{what} are never seen between others that are: the projector scales its picture, so that "
        "panel and screen do not match one to one; switch off its keystone correction and feed it "
        "its native resolution"
    ]


def _step_px(positions: FloatArray) -> float:
    """Mean distance [projector px] of neighbouring camera pixels, along the axis where it is larger."""
    steps = [np.abs(np.diff(positions, axis=axis)) for axis in (0, 1)]
    each = [float(np.nanmean(step)) if np.isfinite(step).any() else np.inf for step in steps]
    return max(each)


def unseen_share(positions: FloatArray) -> float:
    """Share of the columns between the first and last one seen into which no position (N,) falls."""
    if not len(positions):
        return 0.0
    column = np.rint(positions).astype(int)
    count = np.bincount(column - column.min())
    if len(positions) < PIXELS_PER_LINE * len(count):
        return 0.0
    around = np.convolve(count, np.ones(9), "same") / 9
    judged = around >= PIXELS_PER_LINE / 2
    return float(np.mean(count[judged] == 0)) if judged.any() else 0.0
