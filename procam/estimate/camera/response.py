"""The response of a camera's development (sRGB, a gamma, a picture profile) from bracketed photographs.

Photographs are averaged over small squares, flat squares of all brightnesses are chosen, and
`response_fit` fits the curve to their levels.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray
from procam.errors import InputError, NotEnoughData, OutOfModelRange, ShapeError
from procam.estimate.camera.response_checks import check_response
from procam.estimate.camera.response_fit import Blocks, CameraResponseFit

MIN_EXPOSURES = 3
MIN_RATIO = 1.2  # of neighbouring exposures; a third of a stop is 1.26
MAX_GAMMA = 6.0  # between neighbouring exposures; no development is steeper
BLOCKS = 60_000  # squares that a photograph is averaged to, about
BLOCK_PX = (2, 16)  # smallest and largest edge of a square
BINS, PER_BIN = 64, 60  # of brightness; the flattest squares of each are used
MIN_PIXELS = 50


@dataclass(frozen=True, slots=True)
class CameraResponse:
    """Monotonic inverse response of a camera: levels (K,) to light (K,), both from 0 to 1.

    Attributes
    ----------
    sigma : (K,) standard errors of the light, with those of the shutter times.
    exposures_s : (J,) fitted exposures [s], within a few percent of the nominal ones.
    residual : rms residual of the levels, as a share of their range [-].
    """

    levels: Array
    light: Array
    sigma: Array
    exposures_s: Array
    residual: float


def solve_response(
    photos: Iterable[AnyArray], exposures_s: Sequence[float], bits: int
) -> CameraResponse:
    """Inverse response from photographs (H, W) or (H, W, C) of one still scene, in counts.

    Parameters
    ----------
    photos : three or more, read one at a time; all channels share one curve.
    exposures_s : shutter time of each [s], accurate to 2 % since headers round them; the fit solves for
        the deviations and includes them in the standard errors.
    bits : depth of the counts, 8..16.

    Raises
    ------
    NotEnoughData
        Too few or too similar exposures, or levels that no photograph has.
    OutOfModelRange
        No single curve fits: exchanged photographs, automatic exposure, different picture profiles, or
        a scene that moved.
    DidNotConverge
        The fit did not reach a minimum.
    """
    seconds = _checked_exposures(exposures_s)
    if not 8 <= bits <= 16:
        raise InputError(f"bits: {bits} is no depth of a photograph; give 8 to 16")
    blocks = _average(photos, len(seconds), 2.0**bits - 1)
    _check_rise(blocks, seconds)
    fit = CameraResponseFit(_choose(blocks), seconds)
    fit.solve()
    check_response(fit)
    levels = np.linspace(0, 1, 256 if bits == 8 else 1025)
    light, sigma = fit.table(levels)
    return CameraResponse(levels, light, sigma, fit.exposures_s, fit.residual_rms())


def _checked_exposures(exposures_s: Sequence[float]) -> Array:
    seconds = np.asarray(exposures_s, float)
    if len(seconds) < MIN_EXPOSURES:
        raise NotEnoughData(
            f"brackets: {len(seconds)} exposures are too few; photograph the same scene at "
            f"{MIN_EXPOSURES} or more, at 1, 2, 4, 8 ... times the shortest"
        )
    if not (np.isfinite(seconds).all() and (seconds > 0).all()):
        raise InputError(f"exposures: {list(exposures_s)} s must be finite and above zero")
    ordered = np.sort(seconds)
    ratio = ordered[1:] / ordered[:-1]
    if ratio.min() < MIN_RATIO:
        k = int(np.argmin(ratio))
        raise NotEnoughData(
            f"brackets: exposures of {ordered[k]:g} and {ordered[k + 1]:g} s are too similar; neighbours "
            f"need a ratio of {MIN_RATIO:g} or more. Leave one out, and step by a factor of 2"
        )
    return seconds


def _average(photos: Iterable[AnyArray], count: int, top: float) -> Blocks:
    """Means over small squares of every photograph, with all channels in one row."""
    parts, shape, edge = list[tuple[Array, Array, BoolArray]](), None, 1
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
            f"brackets: {len(parts)} photographs and {count} exposures do not match; give one exposure "
            "for each photograph"
        )
    level, deviation, sound = (np.stack(part) for part in zip(*parts, strict=True))
    return Blocks(edge, level, deviation, sound)


def _squares(photo: AnyArray, top: float, edge: int) -> tuple[Array, Array, BoolArray]:
    height, width, channels = photo.shape
    rows, columns = height // edge, width // edge
    cut = photo[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge, channels)
    mean = cut.mean(axis=(1, 3), dtype=float)
    square = np.square(cut, dtype=np.float32).sum(axis=(1, 3), dtype=float)
    variance = np.maximum(square / edge**2 - mean**2, 0)
    sound = (cut.min(axis=(1, 3)) > 0) & (cut.max(axis=(1, 3)) < top)
    return mean.ravel() / top, np.sqrt(variance).ravel() / top, sound.ravel()


def _check_rise(blocks: Blocks, seconds: Array) -> None:
    """Refuse longer exposures that are not brighter."""
    order = np.argsort(seconds)
    for first, second in pairwise(order):
        both = blocks.sound[first] & blocks.sound[second]
        pair = f"photographs {first + 1} and {second + 1} ({seconds[first]:g} and {seconds[second]:g} s)"
        if both.sum() < MIN_PIXELS:
            raise NotEnoughData(
                f"brackets: {pair}: only {int(both.sum())} places are neither black nor white in both; "
                f"{MIN_PIXELS} are needed. Leave out what is all black or white, or take an exposure "
                "between them, of a scene with all shades"
            )
        dim, bright = blocks.level[first][both], blocks.level[second][both]
        lit = dim >= np.percentile(dim, 90)  # darker places may be all noise
        rise = float(np.median(bright[lit] / dim[lit]))
        least = (seconds[second] / seconds[first]) ** (1 / MAX_GAMMA)
        if rise < least:
            raise OutOfModelRange(
                f"brackets: {pair}: the levels change by a factor of {rise:.3f}; {least:.3f} is the least "
                "for these exposures. Check that the photographs are not exchanged, and that neither "
                "exposure nor ISO was automatic"
            )


def _choose(blocks: Blocks) -> Blocks:
    """Flat blocks of all brightnesses, each unclipped in two exposures or more."""
    bright = blocks.level.mean(axis=0)
    rough = np.where(blocks.sound, blocks.deviation, 0).max(axis=0)
    usable = blocks.sound.sum(axis=0) >= 2
    bins = np.minimum(BINS * bright, BINS - 1).astype(int)
    chosen = []
    for each in range(BINS):
        inside = np.flatnonzero(usable & (bins == each))
        chosen.append(inside[np.argsort(rough[inside], kind="stable")[:PER_BIN]])
    return blocks.take(np.concatenate(chosen))
