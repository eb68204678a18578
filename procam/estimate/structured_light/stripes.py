"""Photographs of stripes to columns, pair by pair.

A stripe pattern and its inverse give one bit per camera pixel: the brighter of the two. The decoder
keeps 2 bytes of codeword and two contrasts per pixel, so memory does not grow with the number of
patterns. A bit is certain when the difference of the pair exceeds the noise and what scattered light
can contribute. Patterns that the camera does not resolve are left out; the codewords are then shared
by neighbouring columns, and the standard error grows.
"""

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, BoolArray, Map
from procam.estimate.structured_light.axis import AxisResult
from procam.estimate.structured_light.codes import Plane
from procam.estimate.structured_light.limits import BEYOND_SHARE, DecodeLimits, beyond_panel
from procam.maths.codes.gray import fold_pair
from procam.maths.statistics import robust_sigma

Pair = tuple[AnyArray, AnyArray, int]
WIDEST_LOSS = 8  # columns that may share the remaining bits of a codeword when planes are lost
CLEAR_SIGMAS = 3.0
RESOLVED_SHARE = 0.25  # of the lit pixels must resolve a plane, or it is lost
FLUX_SLACK = 0.02  # imbalance of a pair below which its scattered light cancels
PROBES = 10_000  # pixels of which the lit ones decide whether a plane is resolved
HELD_PAIRS = 2  # folded together: each pair is judged by the direct light that both show


class StripeDecoder:
    """Decodes the stripes of one axis as the photographs arrive; some may be missing.

    A bit is certain when |p - q| > |flux_p - flux_q| global, for pattern p and inverse q (intervals of
    direct and global light, Xu & Aliaga 2007, doi:10.1145/1268517.1268559, with the pair's fluxes
    known). A `lit_share` of 0 in the limits means that there is no scattered light.

    Parameters
    ----------
    codewords : of the columns, (length,). white, black : photographs (H, W) of these pictures.
    """

    def __init__(
        self, codewords: NDArray[np.integer], white: AnyArray, black: AnyArray, limits: DecodeLimits
    ) -> None:
        self._codewords = codewords
        self._contrast = np.broadcast_to(np.float32(limits.contrast), white.shape)
        self._white, self._black = white, black
        self._scattering = limits.lit_share > 0
        self._code = np.zeros(white.shape, np.uint16)
        top = np.inf if white.dtype.kind == "f" else np.iinfo(white.dtype).max
        self._least = np.full(white.shape, top, white.dtype)
        self._most = np.zeros(white.shape, white.dtype)
        self._folded: set[int] = set()
        self._held: list[Pair] = []
        self._waiting: tuple[Plane, AnyArray] | None = None
        self._lost: list[Plane] = []
        some = slice(None, None, max(1, white.size // PROBES))
        span = _difference(np.ravel(white)[some], np.ravel(black)[some])
        self._probe = np.arange(white.size)[some][span > 4 * np.ravel(self._contrast)[some]]
        self._levels = [np.ravel(level)[self._probe] for level in (white, black)]
        self._total = float(white.sum(dtype=float) - black.sum(dtype=float))

    def add(self, plane: Plane, image: AnyArray, variance: Map | None = None) -> None:
        """Add one photograph; a pattern and its inverse follow each other. `variance` is not used."""
        if self._waiting is not None and self._waiting[0].bit == plane.bit:
            (first, other), self._waiting = self._waiting, None
            self._add_ordered(plane, *((image, other) if first.inverse else (other, image)))
            return
        self._complete()
        self._waiting = plane, image

    def result(self) -> AxisResult:
        """The coordinate, from the photographs so far.

        NaN where a bit is uncertain, and where the resolved bits leave more than a few columns.
        """
        self._complete()
        certain = self.certain()
        column, sigma = column_table(self._codewords, self._folded)
        known = certain & np.isfinite(column[self._code])
        beyond = 1 - float(known[certain].mean()) if certain.any() and not self._lost else 0.0
        return AxisResult(
            np.where(known, column[self._code], np.nan).astype(np.float32),
            np.where(known, sigma[self._code], np.nan).astype(np.float32),
            self._most.astype(np.float32),
            None,
            tuple(self._lost),
            refused=beyond_panel(beyond, len(self._codewords), BEYOND_SHARE),
        )

    def certain(self) -> BoolArray:
        """Pixels all of whose bits are certain."""
        self._fold()
        return np.asarray(self._least >= self._contrast) & (self._most > 0)

    def add_pair(self, pattern: AnyArray, inverse: AnyArray, bit: int) -> bool:
        """Add a pair; False, without effect, if hardly any bright pixel resolves the two."""
        probed = (np.ravel(picture)[self._probe] for picture in (pattern, inverse))
        if self._resolved_share(*probed) < RESOLVED_SHARE:
            return False
        self._folded.add(bit)
        self._held.append((pattern, inverse, bit))
        if len(self._held) == HELD_PAIRS:
            self._fold()
        return True

    def _complete(self) -> None:
        """Pair a photograph whose partner is missing: the two add up to white and black."""
        if self._waiting is None:
            return
        (plane, image), self._waiting = self._waiting, None
        other = self._white.astype(np.float32) + self._black - image
        if image.dtype.kind != "f":
            other = np.clip(other, 0, np.iinfo(image.dtype).max).astype(image.dtype)
        self._add_ordered(plane, *((other, image) if plane.inverse else (image, other)))

    def _add_ordered(self, plane: Plane, pattern: AnyArray, inverse: AnyArray) -> None:
        if not self.add_pair(pattern, inverse, plane.bit):
            self._lost.append(plane)

    def _resolved_share(self, pattern: AnyArray, inverse: AnyArray) -> float:
        """Share of the probed pixels whose difference exceeds the noise of their sum.

        Pattern and inverse add up to white and black, so the mismatch is the noise of four samples.
        """
        if not pattern.size:
            return 1.0
        miss = _difference(pattern, self._levels[0]) + _difference(inverse, self._levels[1])
        miss = miss[self._levels[0] < self._levels[0].max()]  # a clipped white has no valid sum
        sigma = robust_sigma(miss) / 2 if miss.size else 0.0
        contrast = np.ravel(self._contrast)[self._probe]
        clear = np.maximum(contrast, CLEAR_SIGMAS * np.sqrt(2) * sigma)
        return float(np.mean(np.abs(_difference(pattern, inverse)) > clear))

    def _fold(self) -> None:
        pairs, self._held = self._held, []
        for pattern, inverse, bit in pairs:
            fold_pair(pattern, inverse, bit, (self._code, self._least, self._most))
        for pattern, inverse, _ in pairs if self._scattering else ():
            self._drop_uncertain(pattern, inverse)

    def _drop_uncertain(self, pattern: AnyArray, inverse: AnyArray) -> None:
        """Clear the least contrast where the pair's surplus of scattered light may flip the bit."""
        surplus = abs(float(pattern.sum(dtype=float) - inverse.sum(dtype=float)))
        if surplus > FLUX_SLACK * self._total:
            span = _difference(self._white, self._black)
            scattered = surplus / self._total * np.maximum(span - self._most, 0)
            self._least[np.abs(_difference(pattern, inverse)) <= scattered] = 0


def column_table(codewords: NDArray[np.integer], folded: set[int]) -> tuple[Map, Map]:
    """Mean and standard error (2^bits,) of the columns whose codeword agrees in `folded` bits."""
    size = 2 ** max(1, int(codewords.max()).bit_length())
    widest = max(WIDEST_LOSS, int(np.bincount(codewords).max()))
    known = codewords & sum(1 << bit for bit in folded)
    columns = np.arange(len(codewords))
    count = np.bincount(known, minlength=size)
    first = np.full(size, len(codewords))
    np.minimum.at(first, known, columns)
    last = np.full(size, -1)
    np.maximum.at(last, known, columns)
    # columns that share the known bits must be neighbours, or their mean means nothing
    good = (count > 0) & (last - first + 1 == count) & (count <= widest)
    mean = np.where(good, (first + last) / 2, np.nan).astype(np.float32)
    sigma = np.where(good, count / np.sqrt(12), np.nan).astype(np.float32)
    return mean, sigma


def _difference(a: AnyArray, b: AnyArray) -> Map:
    return np.subtract(a, b, dtype=np.float32)
