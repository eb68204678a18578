"""Focus, from a picture of stripes and its inverse."""

import numpy as np

from procam.arrays import Image

LIT_SHARE = 0.2  # of the bright level of white, from which pixels count
NOT_WHITE = 0.7  # scattered light counts twice in the sum
NEAR_EDGE = 0.4  # of full contrast: pixels so close to the middle of an edge
SLOPE_QUANTILE = 0.5
MIN_PIXELS = 50


def edge_blur(pattern: Image, inverse: Image, white: Image) -> float:
    """Standard deviation [px] of the blur of stripes' edges; NaN where no edge is seen.

    At the middle of an edge with a Gaussian blur, the difference of a pattern and its inverse (H, W), as a
    share of their sum, has the slope sqrt(2/pi) / blur.
    """
    total = pattern + inverse
    lit = white > LIT_SHARE * float(np.percentile(white, 99))
    lit &= np.abs(total - white) < NOT_WHITE * white  # else a shot mark
    share = np.where(lit, (pattern - inverse) / np.maximum(total, 1e-9), np.float32(np.nan))
    contrast = float(np.nanpercentile(np.abs(share), 90)) if lit.any() else 0.0
    down, across = np.gradient(share)
    slope = np.hypot(down, across)
    with np.errstate(invalid="ignore"):
        near = np.isfinite(slope) & (np.abs(share) < NEAR_EDGE * contrast)
    if near.sum() < MIN_PIXELS or not contrast > 0:
        return float("nan")
    steep = float(np.quantile(slope[near], SLOPE_QUANTILE)) / contrast
    return float(np.sqrt(2 / np.pi) / max(steep, 1e-9))
