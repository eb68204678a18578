"""Focus, from a picture of stripes and its inverse."""

import numpy as np
from scipy.ndimage import maximum_filter

from procam.arrays import Image

LIT_SHARE = 0.2  # of the bright level of white, from which pixels count
NOT_WHITE = 0.7  # scattered light counts twice in the sum
REACH_PX = 12  # within which an edge has full contrast on both sides
LEAST_CONTRAST = 0.3  # of the usual one, on both sides
NEAR_EDGE = 0.4  # of full contrast: pixels so close to the middle of an edge
STEEPEST, FLAT = (
    0.98,
    0.2,
)  # quantile, and share of it below which there is no edge but scattered light
MIN_PIXELS = 50


def edge_blur(pattern: Image, inverse: Image, white: Image) -> float:
    """Standard deviation [px] of the blur of stripes' edges; NaN where no edge is seen.

    At the middle of an edge with a Gaussian blur, the difference of a pattern and its inverse (H, W), as a
    share of their sum, has the slope sqrt(2/pi) / blur of its contrast, which scattered light lowers from
    place to place.
    """
    total = pattern + inverse
    lit = white > LIT_SHARE * float(np.percentile(white, 99))
    lit &= np.abs(total - white) < NOT_WHITE * white  # else a shot mark
    share = np.where(lit, (pattern - inverse) / np.maximum(total, 1e-9), np.float32(np.nan))
    down, across = np.gradient(share)
    slope, known = np.hypot(down, across), np.nan_to_num(share)
    sides = [maximum_filter(side, 2 * REACH_PX + 1) for side in (known, -known)]
    contrast = np.minimum(*sides)
    usual = float(np.percentile(np.abs(known[lit]), 90)) if lit.any() else 0.0
    near = np.isfinite(slope) & (contrast > LEAST_CONTRAST * usual)
    near &= np.abs(known) < NEAR_EDGE * contrast
    if near.sum() < MIN_PIXELS:
        return float("nan")
    edges = slope[near] / contrast[near]
    steep = float(np.median(edges[edges > FLAT * np.quantile(edges, STEEPEST)]))
    return float(np.sqrt(2 / np.pi) / max(steep, 1e-9))
