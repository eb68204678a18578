"""What a decoded map says of the projector: whether it shows every pixel it is sent."""

import numpy as np
from numpy.typing import NDArray

from procam.estimate.structured_light.codes import AXES, Code
from procam.model.correspondence import CorrespondenceMap

PIXELS_PER_LINE = 30  # camera pixels that a column needs on average for its absence to mean much
FINEST_STEP_PX = 0.7
UNSEEN_SHARE = 0.03  # of the columns or rows between seen ones


def panel_notes(code: Code, found: CorrespondenceMap) -> list[str]:
    """Notes on columns and rows that are never seen between others that are.

    A projector that scales its input (keystone correction, a foreign resolution) drops some: the
    way from panel to screen is then not one to one. Only codes that tell single columns show it.
    """
    if code.has_waves:
        return []
    shares = {}
    for i, axis in enumerate(AXES):
        places = found.projector_xy[..., i]
        if _step_px(places) > FINEST_STEP_PX:
            continue  # the camera itself is too coarse to see every column
        unseen = unseen_share(places[found.valid])
        if unseen > UNSEEN_SHARE:
            shares["columns" if axis == "x" else "rows"] = unseen
    if not shares:
        return []
    what = " and ".join(f"{share:.0%} of the {name}" for name, share in shares.items())
    return [
        f"{what} are never seen between others that are: the projector scales its picture, so that "
        "panel and screen do not match one to one; switch off its keystone correction and feed it "
        "its native resolution"
    ]


def _step_px(places: NDArray[np.floating]) -> float:
    """Projector pixels that neighbouring camera pixels lie apart (H, W) along their own axis."""
    steps = [np.abs(np.diff(places, axis=axis)) for axis in (0, 1)]
    each = [float(np.nanmean(step)) if np.isfinite(step).any() else np.inf for step in steps]
    return max(each)


def unseen_share(places: NDArray[np.floating]) -> float:
    """Share of whole columns, between the first and last one seen, that no place (N,) falls into."""
    if not len(places):
        return 0.0
    number = np.rint(places).astype(int)
    count = np.bincount(number - number.min())
    if len(places) < PIXELS_PER_LINE * len(count):
        return 0.0
    around = np.convolve(count, np.ones(9), "same") / 9
    judged = around >= PIXELS_PER_LINE / 2
    return float(np.mean(count[judged] == 0)) if judged.any() else 0.0
