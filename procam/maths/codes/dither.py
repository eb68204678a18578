"""Dither thresholds of blue noise, so that rounding to 8 bits leaves no visible bands."""

from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array32, FloatArray

TILE = 64
STORED = "blue_noise.npz"


@cache
def threshold_tile() -> Array32:
    """Thresholds (64, 64) in 0..1 for rounding; the tile repeats seamlessly.

    floor(value + threshold) is the value on average, and the error is noise of high frequency. The
    thresholds were made by void and cluster (Ulichney 1993, doi:10.1117/12.152707): each rank is as
    far as possible from the lower ones. The program is in the test of this module.
    """
    with files("procam.maths.codes").joinpath(STORED).open("rb") as file, np.load(file) as stored:
        return ((stored["ranks"] + np.float32(0.5)) / TILE**2).astype(np.float32)


def dithered(values: FloatArray, thresholds: FloatArray | None = None) -> NDArray[np.uint8]:
    """Codes of a picture (H, W, C) with values 0..255, rounded by thresholds; row 0 is the tile's."""
    (height, width), tile = values.shape[:2], threshold_tile() if thresholds is None else thresholds
    whole = np.tile(tile, (-(-height // TILE), -(-width // TILE)))[:height, :width, None]
    return np.minimum(values + whole, 255).astype(np.uint8)
