"""What a camera's development does to light: its response from brackets, and a test of linearity.

Photographs may be encoded: sRGB, a gamma, or a picture profile of the camera's own.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.optimize import brentq

from procam.errors import InputError, NotEnoughData, OutOfModelRange, ShapeError
from procam.estimate.camera.response_fit import Blocks, CameraResponseFit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Pixels = NDArray[Any]

FEWEST_EXPOSURES = 3
LEAST_RATIO = 1.2  # of neighbouring exposures; a third of a stop is 1.26
STEEPEST_GAMMA = 6.0  # between neighbouring exposures; a steeper curve is no development
BLOCKS = 60_000  # about as many as a picture is averaged to
BLOCK_PX = (2, 16)
BINS, PER_BIN = 64, 60  # of brightness; the flattest blocks of each
FEWEST_PIXELS = 50
EXPONENTS = (0.2, 6.0)
NEARLY = 0.01  # of white: light that adds up


@dataclass(frozen=True, slots=True)
class CameraResponse:
    """Monotone inverse response of a camera: levels (K,) to light (K,), both from 0 to 1.

    Attributes
    ----------
    sigma : (K,) standard errors of the light, those of the shutter times in them.
    exposures_s : (J,) as the photographs fit them [s], within a few percent of those told.
    residual : rms of the levels about the fit, a share of their range [-].
    """

    levels: Array
    light: Array
    sigma: Array
    exposures_s: Array
    residual: float


@dataclass(frozen=True, slots=True)
class Linearity:
    """How far `pattern + inverse` is above `white + black`, and the power that mends it.

    `error` is a share of white, 0 for linear light; light = counts^`exponent` fits best. Each with its
    standard error.
    """

    error: float
    error_sigma: float
    exponent: float
    exponent_sigma: float


def solve_response(
    photos: Iterable[Pixels], exposures_s: Sequence[float], bits: int
) -> CameraResponse:
    """Inverse response from photographs (H, W) or (H, W, C) of one still scene, in counts.

    Parameters
    ----------
    photos : three or more, read one after the other; all channels are taken to share one curve.
    exposures_s : shutter time of each [s], known to some 2 %: what is rounded in headers is solved
        along, and is in the standard errors.
    bits : depth of the counts, 8..16.

    Raises
    ------
    NotEnoughData : too few exposures, too alike, or levels that no photograph has.
    OutOfModelRange : no single curve fits: photographs exchanged, automatic exposure, another picture
        profile, a scene that moved.
    DidNotConverge : the fit found no end.

    Notes
    -----
    The logarithm of the slope is a cubic spline of the level, so that the curve always rises. Levels
    are predicted from the curve and a brightness per block of pixels, which is eliminated; clipped
    samples count as little as those that noise could have clipped.
    """
    seconds = _checked_exposures(exposures_s)
    if not 8 <= bits <= 16:
        raise InputError(f"bits: got {bits}, expected 8 to 16; give the depth of the counts")
    blocks = _average(photos, len(seconds), 2.0**bits - 1)
    _check_rise(blocks, seconds)
    fit = CameraResponseFit(_choose(blocks), seconds)
    fit.solve()
    levels = np.linspace(0, 1, 256 if bits == 8 else 1025)
    light, sigma = fit.table(levels)
    return CameraResponse(levels, light, sigma, np.exp(fit.shutter), fit.residual_rms())


def linearity_error(white: Pixels, black: Pixels, pattern: Pixels, inverse: Pixels) -> Linearity:
    """Whether counts (H, W) are linear in light, from a stripe picture and its inverse.

    Linear light adds up, scattered light, blur and all: pattern + inverse = white + black. A gamma
    lifts the left side wherever both pictures shine, at edges and by scattered light.

    Parameters
    ----------
    white, black, pattern, inverse : counts above the camera's black level at one exposure; NaN where
        saturated.

    Notes
    -----
    Pixels count by how much both pictures shine around them, not in them: noise that chose its own
    weight would look like a gamma (an instrumental variable).
    """
    pictures = [np.asarray(p, float) for p in (white, black, pattern, inverse)]
    for name, picture in zip(("black", "pattern", "inverse"), pictures[1:], strict=True):
        if picture.shape != pictures[0].shape:
            raise ShapeError(name, picture.shape, f"{pictures[0].shape} like white")
    weight = _both_shine(*pictures)
    top = float(np.nanpercentile(pictures[0], 99.5))
    use = np.all([np.isfinite(p) for p in pictures], axis=0) & (weight > 0)
    use &= pictures[0] > 0.1 * top
    if use.sum() < FEWEST_PIXELS or top <= 0:
        raise NotEnoughData(
            f"linearity: got {int(use.sum())} pixels where both pattern and inverse shine, expected "
            f"{FEWEST_PIXELS}; give stripes that the camera sees, and their inverse"
        )
    return _excess([p[use] / top for p in pictures], weight[use])


def _both_shine(white: Array, black: Array, pattern: Array, inverse: Array) -> Array:
    """Product of the two pictures' shares of white (H, W), of the eight pixels around."""
    around = []
    for picture in (white, black, pattern, inverse):
        known = np.nan_to_num(picture)
        around.append((9 * uniform_filter(known, 3, mode="nearest") - known) / 8)
    span = np.maximum(around[0] - around[1], 1e-9)
    shares = [np.clip((p - around[1]) / span, 0, 1) for p in around[2:]]
    return np.asarray(shares[0] * shares[1])


def _excess(pictures: Sequence[Array], weight: Array) -> Linearity:
    def excess(exponent: float) -> Array:
        # noise may go below black; cut off, it would lift the mean
        powers = (np.sign(p) * np.abs(p) ** exponent for p in pictures)
        white, black, pattern, inverse = powers
        return np.asarray((pattern + inverse - white - black) / white)

    def mean(exponent: float) -> float:
        return float(weight @ excess(exponent) / weight.sum())

    def error(exponent: float) -> float:
        left = excess(exponent) - mean(exponent)
        return float(np.sqrt(np.sum((weight * left) ** 2)) / weight.sum())

    low, high = EXPONENTS
    if mean(low) * mean(high) >= 0 and abs(mean(1.0)) <= NEARLY:
        return Linearity(mean(1.0), error(1.0), 1.0, high - low)  # nothing shows an exponent
    if mean(low) * mean(high) >= 0:
        raise OutOfModelRange(
            f"linearity: got pattern + inverse {mean(1):+.1%} of white off white + black, which no "
            f"exponent from {low:g} to {high:g} mends; are the four pictures those of one stripe code?"
        )
    fits = float(brentq(mean, low, high))
    slope = (mean(fits * 1.001) - mean(fits * 0.999)) / (0.002 * fits)
    return Linearity(mean(1.0), error(1.0), fits, error(fits) / abs(slope))


def _checked_exposures(exposures_s: Sequence[float]) -> Array:
    seconds = np.asarray(exposures_s, float)
    if len(seconds) < FEWEST_EXPOSURES:
        raise NotEnoughData(
            f"brackets: got {len(seconds)} exposures, expected {FEWEST_EXPOSURES} or more; photograph "
            "the same scene at 1, 2, 4, 8 ... times the shortest exposure"
        )
    if not (np.isfinite(seconds).all() and (seconds > 0).all()):
        raise InputError(f"exposures: got {list(exposures_s)} s, expected finite ones above zero")
    ordered = np.sort(seconds)
    ratio = ordered[1:] / ordered[:-1]
    if ratio.min() < LEAST_RATIO:
        k = int(np.argmin(ratio))
        raise NotEnoughData(
            f"brackets: got exposures of {ordered[k]:g} and {ordered[k + 1]:g} s, a ratio of "
            f"{ratio[k]:.3f}, expected {LEAST_RATIO:g} or more between neighbours; leave one out, and "
            "step by a stop (a factor of 2)"
        )
    return seconds


def _average(photos: Iterable[Pixels], count: int, top: float) -> Blocks:
    """Small squares of every photograph; all channels in one row."""
    parts, shape, edge = list[tuple[Array, Array, Mask]](), None, 1
    for number, photo in enumerate(photos, start=1):
        if shape is None:
            shape = photo.shape
            edge = int(np.clip(np.sqrt(np.prod(shape[:2]) / BLOCKS), *BLOCK_PX))
        if photo.ndim not in (2, 3):
            raise ShapeError(f"photograph {number}", photo.shape, "(H, W) or (H, W, C)")
        if photo.shape != shape:
            raise ShapeError(f"photograph {number}", photo.shape, f"{shape} like the first")
        parts.append(_squares(photo.reshape(*photo.shape[:2], -1), top, edge))
    if len(parts) != count:
        raise InputError(
            f"brackets: got {len(parts)} photographs and {count} exposures; give one each"
        )
    level, spread, sound = (np.stack(part) for part in zip(*parts, strict=True))
    return Blocks(edge, level, spread, sound)


def _squares(photo: Pixels, top: float, edge: int) -> tuple[Array, Array, Mask]:
    height, width, channels = photo.shape
    rows, columns = height // edge, width // edge
    cut = photo[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge, channels)
    mean = cut.mean(axis=(1, 3), dtype=float)
    square = np.square(cut, dtype=np.float32).sum(axis=(1, 3), dtype=float)
    variance = np.maximum(square / edge**2 - mean**2, 0)
    sound = (cut.min(axis=(1, 3)) > 0) & (cut.max(axis=(1, 3)) < top)
    return mean.ravel() / top, np.sqrt(variance).ravel() / top, sound.ravel()


def _check_rise(blocks: Blocks, seconds: Array) -> None:
    """Longer exposures are brighter, or photographs are exchanged or exposed automatically."""
    order = np.argsort(seconds)
    for first, second in pairwise(order):
        both = blocks.sound[first] & blocks.sound[second]
        pair = f"photographs {first + 1} and {second + 1} ({seconds[first]:g} and {seconds[second]:g} s)"
        if both.sum() < FEWEST_PIXELS:
            raise NotEnoughData(
                f"brackets: {pair}: got {int(both.sum())} places that are neither black nor white in "
                f"both, expected {FEWEST_PIXELS} or more; leave out what is all black or white, or take an "
                "exposure between them, of a scene with all shades"
            )
        dim, bright = blocks.level[first][both], blocks.level[second][both]
        lit = dim >= np.percentile(dim, 90)  # the others may lie on the floor of noise
        rise = float(np.median(bright[lit] / dim[lit]))
        least = (seconds[second] / seconds[first]) ** (1 / STEEPEST_GAMMA)
        if rise < least:
            raise OutOfModelRange(
                f"brackets: {pair}: got levels that change by a factor of {rise:.3f}, expected "
                f"{least:.3f} or more; are they exchanged, or was exposure or ISO automatic?"
            )


def _choose(blocks: Blocks) -> Blocks:
    """Flat blocks of all brightnesses, each sound in two exposures or more."""
    bright = blocks.level.mean(axis=0)
    rough = np.where(blocks.sound, blocks.spread, 0).max(axis=0)
    usable = blocks.sound.sum(axis=0) >= 2
    bins = np.minimum(BINS * bright, BINS - 1).astype(int)
    chosen = []
    for each in range(BINS):
        inside = np.flatnonzero(usable & (bins == each))
        chosen.append(inside[np.argsort(rough[inside], kind="stable")[:PER_BIN]])
    return blocks.take(np.concatenate(chosen))
