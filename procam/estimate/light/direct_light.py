"""Finds the camera pixels that see direct light of a projector, from its stripes and without any decoding.

White - black is scattered light too, so it is bright beyond the picture. A stripe pattern less its
inverse is direct light, and the scattered light by which their fluxes differ. Edges of Gray patterns never
meet, so in one pattern each pixel lies inside a stripe.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from procam.arrays import AnyArray, BoolArray, Map
from procam.estimate.camera.binning import Binning
from procam.estimate.structured_light.limits import LIT_SHARE
from procam.maths.warp import blur, grow

CLEAR_SIGMAS = 4.0
DIM_SIGMAS = 16.0  # a code's finest patterns keep a quarter of the contrast, of which 4 are needed
BLUR_PX = 0.7  # Gaussian sigma; suppresses the noise of single camera pixels
HOLE_PX, BORDER_PX = 3, 6  # camera pixels
BAND, BEYOND_BLUR = 512, 8  # rows at a time, and beside them
BLURRED = 0.41  # of their noise, that remains; less is taken from what a camera has smoothed itself


@dataclass(frozen=True, slots=True)
class DirectLight:
    """What the stripes of one projector show.

    Attributes
    ----------
    seen : (H, W) they show direct light, also beside the border, where a pixel is lit in part.
    absent : (H, W) they would show a share `LIT_SHARE` of white - black, and do not. Where neither holds
        white is too dark to judge by.
    dim : (H, W) white - black is too near the noise for the finest patterns of a code.
    """

    seen: BoolArray
    absent: BoolArray
    dim: BoolArray

    def binned(self, binning: Binning) -> "DirectLight":
        """The same of blocks of pixels (h, w)."""
        return DirectLight(*(binning.most(mask) for mask in (self.seen, self.absent, self.dim)))


def well_inside(seen: BoolArray) -> BoolArray:
    """What is seen (H, W), holes filled, without its border, where pixels are lit in part."""
    return np.asarray(grow(grow(seen, HOLE_PX), -HOLE_PX - BORDER_PX))


def stripe_contrast(span: Map, pairs: Iterable[tuple[AnyArray, AnyArray]]) -> Map:
    """Largest contrast (H, W) of stripe patterns and their inverses (H, W) each, scattered light subtracted.

    `span` (H, W) is white - black; all are counts [DN].
    """
    contrast, total = np.zeros(span.shape, np.float32), float(span.sum(dtype=float))
    for pattern, inverse in pairs:
        surplus = float(pattern.sum(dtype=float) - inverse.sum(dtype=float)) / max(total, 1e-9)
        for top in range(0, len(span), BAND):
            above = min(top, BEYOND_BLUR)
            rows, around = slice(top, top + BAND), slice(top - above, top + BAND + BEYOND_BLUR)
            difference = np.subtract(pattern[around], inverse[around], dtype=np.float32)
            difference -= np.float32(surplus) * span[around]  # what scattered light has in it
            found = np.abs(blur(difference, BLUR_PX))[above : above + len(contrast[rows])]
            np.maximum(contrast[rows], found, out=contrast[rows])
    return contrast


def find_direct_light(span: Map, contrast: Map, sigma: Map) -> DirectLight:
    """Direct light of a projector.

    Parameters
    ----------
    span : (H, W) white - black [DN]. contrast : (H, W) of its stripes, `stripe_contrast` [DN].
    sigma : (H, W) standard error of a difference of two samples [DN].
    """
    least, clear = LIT_SHARE * blur(span, BLUR_PX), CLEAR_SIGMAS * sigma
    return DirectLight(
        np.asarray(contrast > np.maximum(least, clear)),
        np.asarray((contrast <= least) & (least > BLURRED * clear)),
        np.asarray(span < DIM_SIGMAS * sigma),
    )
