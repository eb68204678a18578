"""Binary codes of projector columns and rows: reflected (Gray), logical (XOR) and long-run."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

FOLD_BLOCK = 1 << 16  # pixels of a stack that are folded at a time
# Changing bits of cyclic codes with long runs, found by search: the first steps, and the bit that
# takes each bit's part in the next turn. Whole turns of these steps walk through all 2^n codewords
# and close. The shortest and longest runs are 4..8, 4..8, 5..10, 6..11 and 6..13 columns.
_TURNS = {
    5: ("34120412", "10234"),
    6: ("2034120531243025", "103245"),
    7: ("5402153621540326", "1230546"),
    8: ("14263517403621503741260357240617", "12305467"),
    9: ("47160354860231740853614250671834", "123456708"),
}


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


def fold_pair(
    pattern: NDArray[Any],
    inverse: NDArray[Any],
    bit: int,
    state: tuple[NDArray[np.uint16], NDArray[Any], NDArray[Any]],
) -> None:
    """Fold a stripe picture and its inverse into the state of a streaming decoder, in place.

    With the contrast c = abs(pattern - inverse): code |= (pattern > inverse) << bit,
    least = min(least, c), most = max(most, c). A pixel that is NaN in either picture has c = 0 and
    bit 0. Rows are taken in blocks that stay in the cache.

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


def plain_codewords(length: int) -> NDArray[np.integer]:
    """Gray codewords of `length` columns, stripes of 2 columns up to half of the panel.

    >>> plain_codewords(6).tolist()
    [0, 1, 3, 2, 6, 7]
    """
    return encode_gray(np.arange(length))


def xor_codewords(length: int, base: int) -> NDArray[np.integer]:
    """Codewords of `length` columns with narrow stripes only, which inter-reflections spare.

    Every Gray plane coarser than the base plane is XORed with it, so stripes are 2^base to
    2^(base + 1) columns wide: base 0 is XOR-02, base 1 is XOR-04. The base plane stays as it is,
    and so does the one finer than that of XOR-04, whose stripes are 2 columns wide. XORing once
    more gives the Gray code back, so no two codewords are equal; neighbours may differ in many
    bits.

    Parameters
    ----------
    length : int
        Columns or rows of the panel.
    base : int
        Plane that the others are XORed with (0 = finest).

    Returns
    -------
    ndarray of int
        (length,) codewords of `bit_count(length)` bits.

    References
    ----------
    Gupta, Agrawal, Veeraraghavan, Narasimhan: "Structured light 3D scanning in the presence of
    global illumination", CVPR 2011.

    Examples
    --------
    >>> xor_codewords(8, base=0).tolist()
    [0, 7, 5, 2, 6, 1, 3, 4]
    >>> longest_stripe(plain_codewords(1024)), longest_stripe(xor_codewords(1024, base=1))
    (512, 4)
    """
    code = plain_codewords(length)
    coarser = max(0, (1 << bit_count(length)) - (2 << base))
    return code ^ (((code >> base) & 1) * coarser)


def long_run_codewords(length: int) -> NDArray[np.integer]:
    """Gray codewords of `length` columns whose stripes are all of middling width.

    Neighbours differ in one bit, as in the reflected code, but its finest planes, which blur and
    scattering wipe out, are missing, and so are its coarsest ones, which inter-reflections flip.
    Stripes in columns, those cut by the panel's border may be narrower:

    ========= === === === === === === === === ===
    bits        5   6   7   8   9  10  11  12  13
    narrowest   4   4   5   6   6   8   8   8   9
    widest      8   8  10  11  13  15  18  20  20
    ========= === === === === === === === === ===

    Up to 4 bits it is the reflected code. Every code is the beginning of a cycle of all codewords.

    Parameters
    ----------
    length : int
        Columns or rows of the panel.

    Returns
    -------
    ndarray of int
        (length,) codewords of `bit_count(length)` bits.

    References
    ----------
    Gupta, Agrawal, Veeraraghavan, Narasimhan: "Structured light 3D scanning in the presence of
    global illumination", CVPR 2011 (the 10-bit code, stripes of 8 to 32 columns).
    Goddyn, Gvozdjak: "Binary Gray codes with long bit runs", Electronic Journal of Combinatorics
    10 (2003) R27 (interleaving).

    Examples
    --------
    >>> long_run_codewords(8).tolist(), long_run_codewords(40)[-8:].tolist()
    ([0, 1, 3, 2, 6, 7, 5, 4], [15, 11, 10, 2, 18, 16, 20, 21])
    >>> code = long_run_codewords(1920)
    >>> shortest_stripe(code), longest_stripe(code)
    (8, 18)
    """
    return _long_run_cycle(bit_count(length))[:length].copy()


def shortest_stripe(codewords: NDArray[np.integer]) -> int:
    """Columns of the narrowest stripe of any plane, all columns where no stripe has two edges.

    Stripes cut by the panel's border do not count.

    >>> shortest_stripe(plain_codewords(64)), shortest_stripe(plain_codewords(2))
    (2, 2)
    """
    widths = [np.diff(edges).min(initial=len(codewords)) for edges in _edges(codewords)]
    return int(min(widths))


def longest_stripe(codewords: NDArray[np.integer]) -> int:
    """Columns of the widest stripe of any plane; the panel's border is an edge.

    >>> longest_stripe(plain_codewords(64))
    32
    """
    size = len(codewords)
    return int(max(np.diff(at, prepend=0, append=size).max() for at in _edges(codewords)))


def _edges(codewords: NDArray[np.integer]) -> list[NDArray[np.intp]]:
    """First columns of the stripes of each plane, without column 0."""
    change = codewords[1:] ^ codewords[:-1]
    return [np.flatnonzero((change >> bit) & 1) + 1 for bit in range(bit_count(len(codewords)))]


@cache
def _long_run_cycle(bits: int) -> NDArray[np.integer]:
    """All codewords of a cyclic Gray code with long runs."""
    if bits < min(_TURNS):
        return plain_codewords(2**bits)
    if bits in _TURNS:
        return _turning_cycle(bits)
    return _interleaved_cycle(*((5, 8, 13) if bits == 13 else (2, bits - 2, 1)))


def _turning_cycle(bits: int) -> NDArray[np.integer]:
    """Walk that repeats its steps with the bits swapped each turn."""
    first, image = _TURNS[bits]
    following = np.array([int(bit) for bit in image])
    turn = np.array([int(bit) for bit in first])
    steps = [turn]
    for _ in range(2**bits // len(turn) - 1):
        steps.append(following[steps[-1]])
    return np.bitwise_xor.accumulate(np.r_[0, 1 << np.concatenate(steps)[:-1]])


def _interleaved_cycle(low: int, high: int, share: int) -> NDArray[np.integer]:
    """Cycle of `low` + `high` bits: of 2^low steps, `share` go on in the low bits' cycle.

    The rest go on in the high bits' cycle. When `share` is odd and `low` <= `high`, each pair of
    places in the two cycles comes exactly once (theorem of Goddyn and Gvozdjak): the sum of the
    places tells k modulo 2^low, and among such k the place in the high bits' cycle goes on by
    2^low - `share`, which is odd, so that it comes to all places before it repeats.
    """
    step = np.arange(2 ** (low + high))
    low_steps = (step * share) >> low
    low_code = _long_run_cycle(low)[low_steps % 2**low]
    high_code = _long_run_cycle(high)[(step - low_steps) % 2**high]
    return low_code | (high_code << low)
