"""Reflected binary (Gray) codes of projector columns and rows."""

import numpy as np
from numpy.typing import NDArray


def bit_count(length: int) -> int:
    """Bits that tell `length` columns or rows apart.

    >>> bit_count(1280), bit_count(1024), bit_count(2)
    (11, 10, 1)
    """
    return max(1, (length - 1).bit_length())


def encode_gray(index: NDArray[np.integer]) -> NDArray[np.integer]:
    """Gray code of integers: neighbours differ in one bit."""
    return index ^ (index >> 1)


def decode_gray(code: NDArray[np.integer], bits: int) -> NDArray[np.integer]:
    """Integers of Gray codes of at most `bits` bits; the inverse of `encode_gray`."""
    index = code.copy()
    shift = 1
    while shift < bits:
        index ^= index >> shift
        shift *= 2
    return index


def stripe(length: int, bit: int) -> NDArray[np.bool_]:
    """Which of `length` columns are bright in the plane of `bit` (0 = finest)."""
    return ((encode_gray(np.arange(length)) >> bit) & 1).astype(bool)


def edge_distance(coordinate: NDArray[np.floating], bit: int) -> NDArray[np.floating]:
    """Distance [px] to the nearest stripe edge of the plane of `bit`, ignoring the panel's border.

    Edges lie half a pixel before the columns 2^bit (1, 3, 5, ...). NaN stays NaN.
    """
    period = coordinate.dtype.type(2 ** (bit + 1))
    phase = (coordinate + coordinate.dtype.type(0.5)) / period
    phase -= np.floor(phase)
    phase -= coordinate.dtype.type(0.5)
    return np.asarray(np.abs(phase, out=phase) * period)


def is_bright(index: NDArray[np.integer], bit: int) -> NDArray[np.bool_]:
    """Whether columns of number `index` are bright in the plane of `bit`."""
    return ((encode_gray(index) >> bit) & 1).astype(bool)
