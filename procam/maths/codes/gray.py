"""The reflected binary (Gray) code of projector columns and rows."""

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, BoolArray, FloatArray

FOLD_BLOCK = 1 << 16  # pixels folded at a time: few enough to stay in the cache


def encode_gray(index: NDArray[np.integer]) -> NDArray[np.integer]:
    """Gray codewords of integers: those of neighbours differ in one bit.

    >>> encode_gray(np.arange(6)).tolist()
    [0, 1, 3, 2, 6, 7]
    """
    return index ^ (index >> 1)


def is_bright(index: NDArray[np.integer], bit: int) -> BoolArray:
    """Whether the columns `index` are bright in the plane of `bit` (0 = finest)."""
    return ((encode_gray(index) >> bit) & 1).astype(bool)


def stripe(length: int, bit: int) -> BoolArray:
    """Which of `length` columns are bright in the plane of `bit` (0 = finest)."""
    return is_bright(np.arange(length), bit)


def fold_pair(
    pattern: AnyArray,
    inverse: AnyArray,
    bit: int,
    state: tuple[NDArray[np.uint16], AnyArray, AnyArray],
) -> None:
    """Fold a stripe picture and its inverse into the state of a streaming decoder, in place.

    With the contrast c = abs(pattern - inverse): code |= (pattern > inverse) << bit,
    least = min(least, c), most = max(most, c). A pixel that is NaN in either picture has c = 0 and
    bit 0.

    Parameters
    ----------
    pattern, inverse : (H, ...) of one shape and type [any unit]. bit : 0 to 15.
    state : code, least and most, of the pictures' shape; the last two of their type.

    Examples
    --------
    >>> code, least, most = np.zeros(3, np.uint16), np.full(3, 255, np.uint8), np.zeros(3, np.uint8)
    >>> fold_pair(np.uint8([9, 2, 5]), np.uint8([1, 7, 5]), 2, (code, least, most))
    >>> print(code, least, most)
    [4 0 0] [8 5 0] [8 5 0]
    """
    step = max(1, FOLD_BLOCK * len(pattern) // max(1, pattern.size))
    for first in range(0, len(pattern), step):
        rows = slice(first, first + step)
        p, q, (code, least, most) = pattern[rows], inverse[rows], (part[rows] for part in state)
        with np.errstate(invalid="ignore"):
            contrast = np.maximum(p, q) - np.minimum(p, q)
        if contrast.dtype.kind == "f":
            contrast[np.isnan(contrast)] = 0
        code |= (p > q) * np.uint16(1 << bit)
        np.minimum(least, contrast, out=least)
        np.maximum(most, contrast, out=most)


def stripe_edge_distance(coordinate: FloatArray, bit: int) -> FloatArray:
    """Distance [px] to the nearest stripe edge of the plane of `bit`, ignoring the panel's border.

    Edges lie half a pixel before the columns 2^bit (1, 3, 5, ...). NaN stays NaN.
    """
    period = coordinate.dtype.type(2 ** (bit + 1))
    phase = (coordinate + coordinate.dtype.type(0.5)) / period
    phase -= np.floor(phase)
    phase -= coordinate.dtype.type(0.5)
    return np.asarray(np.abs(phase, out=phase) * period)
