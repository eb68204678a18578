"""Outliers of a correspondence map: they are dropped, and nothing is filled in."""

import numpy as np

from procam.arrays import BoolArray
from procam.maths.warp import local_median
from procam.model.correspondence import CorrespondenceMap

SIGMAS = 6.0
STEP_PX = 1.5  # by which neighbours may differ beyond noise: the slope of the map


def keep_only(found: CorrespondenceMap, keep: BoolArray) -> CorrespondenceMap:
    """The map with everything outside `keep` (H, W) unknown."""
    keep = keep & found.valid
    return CorrespondenceMap(
        np.where(keep[..., None], found.projector_xy, np.float32(np.nan)),
        np.where(keep[..., None], found.sigma_px, np.float32(np.nan)),
        keep,
        found.shared_px,
    )


def drop_outliers(found: CorrespondenceMap) -> CorrespondenceMap:
    """Drop pixels that disagree with the median of their 5 x 5 neighbourhood.

    The map is smooth at that scale, and a misread code is off by whole fringes or bits.
    """
    keep = found.valid.copy()
    for i in range(2):
        middle = local_median(found.projector_xy[..., i], found.valid)
        with np.errstate(invalid="ignore"):
            miss = np.abs(found.projector_xy[..., i] - middle)
            keep &= miss <= STEP_PX + SIGMAS * found.sigma_px[..., i]
    return keep_only(found, keep)
