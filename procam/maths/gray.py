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

    Edges lie half a pixel before the columns 2^bit (1, 3, 5, ...).
    """
    period = 2.0 ** (bit + 1)
    phase = np.mod(coordinate + 0.5, period)
    return np.abs(phase - period / 2)


def is_bright(coordinate: NDArray[np.floating], bit: int) -> NDArray[np.bool_]:
    """Whether a (fractional) projector coordinate lies in a bright stripe of the plane of `bit`."""
    index = np.rint(np.nan_to_num(coordinate, nan=0.0)).astype(np.int64)
    return ((encode_gray(np.maximum(index, 0)) >> bit) & 1).astype(bool)
