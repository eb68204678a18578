"""Stripe pictures to codewords, one pair at a time, and codewords to columns."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.estimate.structured_light.codes import AxisCode
from procam.maths.codes.gray import fold_pair

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]
Samples = NDArray[Any]
Pair = tuple[Samples, Samples, int]
WIDEST_LOSS = 8  # columns that may share what is left of a codeword when planes are lost
CLEAR_SIGMAS = 3.0
RESOLVED_SHARE = 0.25  # of the lit pixels must see a plane, or it is lost
FLUX_SLACK = 0.02  # imbalance of a pair below which its scattered light cancels
PROBES = 10_000  # pixels of which the lit ones tell whether a plane is resolved
HELD_PAIRS = 2


class StripeFolder:
    """Codewords of one axis, folded together as the pairs arrive, two pairs at a time.

    The state is 2 bytes of code and two samples (least and most contrast) per pixel. A bit is certain
    when pattern minus inverse stands clear of noise and of what scattered light can contribute
    (intervals of direct and global light, Xu & Aliaga 2007, doi:10.1145/1268517.1268559, with the
    pair's fluxes known): |p - q| > |flux_p - flux_q| global. Without `scattering` there is none.
    """

    def __init__(
        self, white: Samples, black: Samples, contrast: float, scattering: bool = True
    ) -> None:
        self._white, self._black, self._contrast = white, black, contrast
        self._scattering = scattering
        self._code = np.zeros(white.shape, np.uint16)
        # the least of no contrast yet is the largest number there is
        top = np.inf if white.dtype.kind == "f" else np.iinfo(white.dtype).max
        self._least = np.full(white.shape, top, white.dtype)
        self._most = np.zeros(white.shape, white.dtype)
        self._folded: set[int] = set()
        self._held: list[Pair] = []
        some = slice(None, None, max(1, white.size // PROBES))
        span = _difference(np.ravel(white)[some], np.ravel(black)[some])
        self._probe = np.arange(white.size)[some][span > 4 * contrast]
        self._levels = [np.ravel(level)[self._probe] for level in (white, black)]
        self._total = float(white.sum(dtype=float) - black.sum(dtype=float))

    def add(self, pattern: Samples, inverse: Samples, bit: int) -> bool:
        """Fold a pair in; False, and nothing done, if hardly any bright pixel tells the two apart."""
        probed = (np.ravel(picture)[self._probe] for picture in (pattern, inverse))
        if self._resolved_share(*probed) < RESOLVED_SHARE:
            return False
        self._folded.add(bit)
        self._held.append((pattern, inverse, bit))
        if len(self._held) == HELD_PAIRS:
            self._fold()
        return True

    def _resolved_share(self, pattern: Samples, inverse: Samples) -> float:
        """Share of the probed pixels that tell a pair apart, by the noise that its sum shows.

        Pattern and inverse add up to white and black; what they miss that by is four samples' noise.
        """
        if not pattern.size:
            return 1.0
        miss = _difference(pattern, self._levels[0]) + _difference(inverse, self._levels[1])
        miss = miss[self._levels[0] < self._levels[0].max()]  # a clipped white adds up to nothing
        sigma = 1.4826 * float(np.median(np.abs(miss - np.median(miss)))) / 2 if miss.size else 0.0
        clear = max(self._contrast, CLEAR_SIGMAS * np.sqrt(2) * sigma)
        return float(np.mean(np.abs(_difference(pattern, inverse)) > clear))

    def most(self) -> Samples:
        """Largest contrast (H, W): the direct light; high by noise and by what scattered light adds."""
        self._fold()
        return self._most

    def certain(self) -> Mask:
        """Pixels all of whose bits are certain."""
        self._fold()
        return np.asarray(self._least >= self._contrast) & (self._most > 0)

    def columns(self, coding: AxisCode) -> tuple[Map, Map]:
        """Column (H, W) of each codeword and how far it may be off (standard error) [stripes].

        NaN where the bits that were folded in leave more than a few neighbouring columns.
        """
        self._fold()
        assert coding.codewords is not None
        column, sigma = column_table(coding.codewords, coding.bits, self._folded)
        return column[self._code], sigma[self._code]

    def _fold(self) -> None:
        """What is held goes into the state, which is then read and written once for all of it."""
        if not self._held:
            return
        pairs, self._held = self._held, []
        for pattern, inverse, bit in pairs:
            fold_pair(pattern, inverse, bit, (self._code, self._least, self._most))
        for pattern, inverse, _ in pairs if self._scattering else ():
            surplus = abs(float(pattern.sum(dtype=float) - inverse.sum(dtype=float)))
            if surplus > FLUX_SLACK * self._total:
                span = _difference(self._white, self._black)
                scattered = surplus / self._total * np.maximum(span - self._most, 0)
                self._least[np.abs(_difference(pattern, inverse)) <= scattered] = 0


def column_table(codewords: NDArray[np.integer], bits: int, folded: set[int]) -> tuple[Map, Map]:
    """Mean and standard error (2^bits,) of the columns whose codeword agrees in `folded` bits."""
    mask = sum(1 << bit for bit in folded)
    known = codewords & mask
    columns = np.arange(len(codewords))
    count = np.bincount(known, minlength=2**bits)
    first = np.full(2**bits, len(codewords))
    np.minimum.at(first, known, columns)
    last = np.full(2**bits, -1)
    np.maximum.at(last, known, columns)
    # codewords that share the known bits must be neighbours, or the place is anybody's guess
    good = (count > 0) & (last - first + 1 == count) & (count <= WIDEST_LOSS)
    mean = np.where(good, (first + last) / 2, np.nan).astype(np.float32)
    sigma = np.where(good, count / np.sqrt(12), np.nan).astype(np.float32)
    return mean, sigma


def _difference(a: Samples, b: Samples) -> Map:
    return np.subtract(a, b, dtype=np.float32)
