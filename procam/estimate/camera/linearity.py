"""Test of whether counts are linear in light, from a stripe picture and its inverse.

Linear light adds up, including scattered light and blur: pattern + inverse = white + black. A gamma
raises the left side at all pixels where both pictures are bright, at edges and by scattered light.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.optimize import brentq

from procam.arrays import AnyArray, Array, Map
from procam.errors import NotEnoughData, OutOfModelRange

MIN_PIXELS = 50
MIN_LEVEL = 0.1  # of the brightest white, for a pixel to count
EXPONENTS = (0.2, 6.0)  # range of the search
NEGLIGIBLE = 0.01  # error, as a share of white, that does not need an exponent


@dataclass(frozen=True, slots=True)
class Linearity:
    """Excess of `pattern + inverse` over `white + black`, and the exponent that removes it.

    `error` is a share of white, 0 for linear light; light = counts^`exponent` fits best. Each has its
    standard error.
    """

    error: float
    error_sigma: float
    exponent: float
    exponent_sigma: float


def linearity_error(
    white: AnyArray, black: AnyArray, pattern: AnyArray, inverse: AnyArray
) -> Linearity:
    """Test the linearity of counts (H, W).

    Parameters
    ----------
    white, black, pattern, inverse : counts above the camera's black level at one exposure; NaN where
        saturated.

    Raises
    ------
    NotEnoughData
        Pattern and inverse are nowhere bright together.
    OutOfModelRange
        No exponent removes the error.

    Notes
    -----
    The weight of a pixel is how bright both pictures are at its neighbours, an instrumental variable:
    weights from the pixel itself would correlate with its noise and resemble a gamma.
    """
    pictures = [np.asarray(p, np.float32) for p in (white, black, pattern, inverse)]
    weight = _brightness_of_both(*pictures)
    top = float(np.nanpercentile(pictures[0], 99.5))
    use = np.all([np.isfinite(p) for p in pictures], axis=0) & (weight > 0)
    use &= pictures[0] > MIN_LEVEL * top
    if use.sum() < MIN_PIXELS or top <= 0:
        raise NotEnoughData(
            f"linearity: only {int(use.sum())} pixels are bright in both pattern and inverse; {MIN_PIXELS} "
            "are needed. Give stripes that the camera sees, and their inverse"
        )
    return _solve_exponent(
        [p[use].astype(float) / top for p in pictures], weight[use].astype(float)
    )


def _brightness_of_both(white: Map, black: Map, pattern: Map, inverse: Map) -> Map:
    """Product of the two pictures' shares of white (H, W), averaged over the eight neighbours."""
    around = []
    for picture in (white, black, pattern, inverse):
        known = np.nan_to_num(picture)
        around.append((9 * uniform_filter(known, 3, mode="nearest") - known) / 8)
    span = np.maximum(around[0] - around[1], 1e-9)
    shares = [np.clip((p - around[1]) / span, 0, 1) for p in around[2:]]
    return np.asarray(shares[0] * shares[1], np.float32)


def _solve_exponent(pictures: Sequence[Array], weight: Array) -> Linearity:
    def excess(exponent: float) -> Array:
        # noise below black keeps its sign; cut off, it would raise the mean
        powers = (np.sign(p) * np.abs(p) ** exponent for p in pictures)
        white, black, pattern, inverse = powers
        return np.asarray((pattern + inverse - white - black) / white)

    def mean(exponent: float) -> float:
        return float(weight @ excess(exponent) / weight.sum())

    def error(exponent: float) -> float:
        residual = excess(exponent) - mean(exponent)
        return float(np.sqrt(np.sum((weight * residual) ** 2)) / weight.sum())

    low, high = EXPONENTS
    bracketed = mean(low) * mean(high) < 0
    if not bracketed and abs(mean(1.0)) <= NEGLIGIBLE:
        return Linearity(mean(1.0), error(1.0), 1.0, high - low)  # any exponent fits
    if not bracketed:
        raise OutOfModelRange(
            f"linearity: pattern + inverse differs by {mean(1):+.1%} of white from white + black, and no "
            f"exponent from {low:g} to {high:g} removes that; check that the four pictures are those of "
            "one stripe code"
        )
    best = float(brentq(mean, low, high))
    slope = (mean(best * 1.001) - mean(best * 0.999)) / (0.002 * best)
    return Linearity(mean(1.0), error(1.0), best, error(best) / abs(slope))
