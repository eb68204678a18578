"""Outliers of a correspondence map, which are dropped, and the standard error that a pixel's area adds.

A camera pixel gathers light from an area, and its position is the mean of that light: where paint or
a border makes one side brighter, it is off by the variance of the area times the gradient of the log
light (docs/theory/structured-light.md (S8)). The camera's own blur is not known, so the bias enters the
standard error. Beyond the panel's edge a pixel still sees blurred light of the outermost columns.
"""

import numpy as np
from scipy.ndimage import maximum_filter

from procam.arrays import BoolArray, Map
from procam.maths.warp import local_median
from procam.model.correspondence import CorrespondenceMap

SIGMAS = 6.0
STEP_PX = 1.5  # by which neighbours may differ beyond noise: the slope of the map
AREA_PX2 = 1 / 6  # variance along an axis [camera px^2]: 1/12 of a square, and as much by the lens
STEP = 2  # camera pixels to either side, over which the slope of the map is taken
STEEPEST = 3.0  # slope of the map over its median: above, it is a jump between surfaces
EDGE_PX = 1.5  # from the edge of the panel, within which light may come from beyond it
HALF_LIT = 0.5  # of the brightest of the surroundings: the edge of the picture runs here
AROUND = 5  # camera pixels, edge of these surroundings


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


def with_area_error(found: CorrespondenceMap, span: Map, least: float | Map) -> CorrespondenceMap:
    """The map with what the light's slope within a pixel adds to its standard error.

    `span` (H, W) is white - black, of which less than `least`, one or (H, W), counts as `least`.
    """
    down, across = np.gradient(np.log(np.maximum(span, np.maximum(least, 1e-9))))
    error = np.zeros(found.sigma_px.shape, np.float32)
    for i in range(2):
        by_row, by_column = (_slope(found.projector_xy[..., i], axis) for axis in (0, 1))
        error[..., i] = AREA_PX2 * np.abs(down * by_row + across * by_column)
    sigma = np.hypot(found.sigma_px, error).astype(np.float32)
    return CorrespondenceMap(found.projector_xy, sigma, found.valid, found.shared_px)


def drop_beyond_panel(
    found: CorrespondenceMap, span: Map, size: tuple[int, int]
) -> CorrespondenceMap:
    """The map without pixels at the panel's edge that have less than half of the light around them."""
    brightest = maximum_filter(np.where(found.valid, span, 0), AROUND)
    with np.errstate(invalid="ignore"):
        xy = found.projector_xy
        at_edge = ((xy < EDGE_PX - 0.5) | (xy > np.array(size) - 0.5 - EDGE_PX)).any(axis=-1)
    beyond: BoolArray = at_edge & (span < HALF_LIT * brightest)
    return keep_only(found, ~beyond)


def _slope(positions: Map, axis: int) -> Map:
    """Projector pixels (H, W) per camera pixel along an axis; the median where neighbours are unknown."""
    slope = np.full(positions.shape, np.nan, np.float32)
    along, moved = np.moveaxis(positions, axis, 0), np.moveaxis(slope, axis, 0)
    moved[STEP:-STEP] = (along[2 * STEP :] - along[: -2 * STEP]) / (2 * STEP)
    known = np.isfinite(slope)
    if not known.any():
        return np.ones_like(slope)
    usual, most = np.median(slope[known]), STEEPEST * np.median(np.abs(slope[known]))
    return np.asarray(np.clip(np.where(known, slope, usual), -most, most), np.float32)
