"""Sinusoidal pictures of one axis to columns with standard errors (docs/theory/structured-light.md (S3))."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import AnyArray, Array32, BoolArray, Map
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.structured_light.self_calibration import (
    UNKNOWNS,
    SelfCalibration,
    SinusoidImages,
    find_columns,
    self_calibrate,
)
from procam.kernels import PhaseFit
from procam.maths.codes.phase import WaveDistortion, Waves

BAND = 256  # rows at a time
EQUAL = 1e-6  # sum of the phasors of equal steps
MIN_SAMPLES = 5  # of a pixel: two more than its unknowns, as a check
NEGLIGIBLE_SURPLUS = 1e-4  # of the flux; moves columns by less than 0.01 px
MAX_FULL_SEARCHES = 60_000  # pixels without a base set, each of which searches all columns
AMPLITUDE_SIGMAS = 5.0
BRIGHT_SHARE = 0.2  # of the largest amplitude: dimmer pixels are edges, or lit by scattered light
MARGIN_SIGMAS2 = 12.0  # least chi squared by which the next best fringe must fit worse
MISFIT_SIGMAS2 = 35.0  # most chi squared beyond its expectation
PLAUSIBLE_GAMMA = 1.15  # between the response that sinusoids were drawn for and the real one
UNSEEN_HARMONIC = (PLAUSIBLE_GAMMA - 1) / (
    PLAUSIBLE_GAMMA + 2
)  # second one, of cos^2 to this power


def complete_base_set(
    frames: dict[int, AnyArray], waves: Waves, white: AnyArray, black: AnyArray
) -> dict[int, AnyArray]:
    """Reconstruct a single lost picture of a base set of three equal steps from white and black.

    Equal steps of a sinusoid add up to a multiple of white + black. Returns the pictures (by number)
    unchanged for another number of lost pictures or another base.
    """
    base = waves.base
    if abs(np.exp(1j * waves.shifts[:base]).sum()) > EQUAL:
        return frames
    present = [frames[i] for i in range(base) if i in frames]
    if base != UNKNOWNS or len(present) != base - 1:
        return frames
    (lost,) = set(range(base)) - set(frames)
    total = base / 2 * (white.astype(np.float32) + black)
    restored = np.asarray(total - np.sum(present, axis=0, dtype=np.float32), np.float32)
    return {i: f.astype(np.float32) for i, f in frames.items()} | {lost: restored}


@dataclass(frozen=True, slots=True)
class SinusoidResult:
    """One decoded axis.

    Attributes
    ----------
    x, sigma : (H, W) column and its standard error [px]; NaN where unknown.
    amplitude : (H, W) half of the direct light, corrected for blur [image unit].
    distortion, noise : as the self-calibration found them.
    period_px : mean of the waves' periods.
    unplaced : share of the pixels with a clear wave that fits no column of the panel.
    """

    x: Map
    sigma: Map
    amplitude: Map
    distortion: WaveDistortion
    noise: NoiseLaw
    period_px: float
    unplaced: float = 0.0


def decode_sinusoids(pictures: SinusoidImages) -> SinusoidResult:
    """Decode one axis; pixels with dropped samples are decoded from the others, five or more.

    Beneath sinusoids, stripes identify the period; then all sinusoids of a pixel are needed.
    """
    waves, frames, cells = pictures.waves, pictures.frames, pictures.cells
    least = MIN_SAMPLES if cells is None else len(frames)
    short = np.logical_or.reduce(pictures.dropped)
    known = self_calibrate(pictures)
    found = find_columns(frames, waves, known.distortion, pictures.length, cells)
    scattered = np.zeros(short.shape, np.float32)
    if np.abs(known.surplus).max() > NEGLIGIBLE_SURPLUS:
        scattered = _scattered(pictures, known, found)
        _find_balanced(pictures, known, scattered, found)
    count = np.full(short.shape, len(frames), np.int16)
    if short.any():
        count -= np.sum(pictures.dropped, axis=0, dtype=np.int16)
        rest = short & pictures.usable & (count >= least)
        _search_rest(pictures, known, scattered, rest, found)
    noise = pictures.variance
    if noise is None:
        noise = known.noise.variance(found.offset).astype(np.float32)
    ok = _trusted(found, count, noise) & (count >= least)
    unplaced = _unplaced_share(found, ok, count, noise)
    unseen = unseen_harmonic_px(waves) if pictures.hides_harmonic else 0.0
    x, sigma, amplitude = found.position, found.variance, found.amplitude  # which become the result
    x[~ok] = np.nan
    sigma *= noise
    sigma += np.float32(unseen**2)
    sigma[~ok] = np.nan
    amplitude[short & ~ok] = 0
    amplitude /= np.float32(known.distortion.depth(waves))
    return SinusoidResult(
        x,
        np.sqrt(sigma, out=sigma),
        np.nan_to_num(amplitude, copy=False),
        known.distortion,
        known.noise,
        float(waves.periods.mean()),
        unplaced,
    )


def unseen_harmonic_px(waves: Waves) -> float:
    """Standard error [px] of three equal steps, whose fit cannot show the harmonic of a wrong gamma.

    A harmonic h moves the phase by up to h, as the sine of thrice the phase. A fourth pattern of another
    period shows it too poorly.
    """
    return float(UNSEEN_HARMONIC / np.sqrt(2) * waves.periods[0] / (2 * np.pi))


def _scattered(pictures: SinusoidImages, known: SelfCalibration, found: PhaseFit) -> Map:
    """Scattered light (H, W) of white."""
    direct = 2 / known.distortion.depth(pictures.waves) * np.nan_to_num(found.amplitude)
    return np.asarray(np.maximum(pictures.span - direct, 0), np.float32)


def _find_balanced(
    pictures: SinusoidImages, known: SelfCalibration, scattered: Map, found: PhaseFit
) -> None:
    """Decode the photographs less the scattered light of their surplus flux into `found`, in place.

    Some rows at a time: all of them in single precision would be much memory.
    """
    cells = pictures.cells
    for top in range(0, len(scattered), BAND):
        rows = slice(top, top + BAND)
        frames = _balanced(pictures, known, scattered, rows)
        some = None if cells is None else cells.at(rows)
        part = find_columns(frames, pictures.waves, known.distortion, pictures.length, some)
        for values, new in zip(found, part, strict=True):
            values[rows] = new


def _balanced(
    pictures: SinusoidImages, known: SelfCalibration, scattered: Map, where: slice | BoolArray
) -> list[Array32]:
    """The photographs in some places, less the scattered light of their surplus flux."""
    return [
        np.asarray(frame[where] - np.float32(surplus) * scattered[where], np.float32)
        for frame, surplus in zip(pictures.frames, known.surplus, strict=True)
    ]


def _search_rest(
    pictures: SinusoidImages,
    known: SelfCalibration,
    scattered: Map,
    rows: BoolArray,
    found: PhaseFit,
) -> None:
    """Decode the pixels `rows` (H, W) with missing samples into `found`, in place."""
    samples = np.stack(_balanced(pictures, known, scattered, rows), axis=1)
    keep = ~np.stack([d[rows] for d in pictures.dropped], axis=1)
    answers = np.full((len(found), len(samples)), np.nan, np.float32)
    for pattern in np.unique(keep, axis=0):
        some = np.flatnonzero((keep == pattern).all(axis=1))
        waves = pictures.waves.kept(pattern)
        if waves.base < UNKNOWNS and not waves.single:
            some = some[: max(0, MAX_FULL_SEARCHES - int(np.isfinite(answers[0]).sum()))]
        if not some.size:
            continue
        columns = list(np.ascontiguousarray(samples[np.ix_(some, pattern)].T))
        fits = find_columns(columns, waves, known.distortion, pictures.length)
        answers[:, some] = np.stack(fits)
    for part, answer in zip(found, answers, strict=True):
        part[rows] = answer


def _trusted(found: PhaseFit, count: AnyArray, variance: Map) -> BoolArray:
    """Pixels (H, W) with a clear, unambiguous and well fitting wave, given a sample's variance."""
    with np.errstate(invalid="ignore"):
        ok = found.amplitude > AMPLITUDE_SIGMAS * _amplitude_sigma(count, variance)
        ok &= found.margin >= MARGIN_SIGMAS2 * variance
        ok &= found.residual <= (count - UNKNOWNS + MISFIT_SIGMAS2) * variance
        ok &= np.isfinite(found.position)
    return np.asarray(ok)


def _unplaced_share(found: PhaseFit, ok: BoolArray, count: AnyArray, variance: Map) -> float:
    """Share of the pixels with a clear wave that are not trusted."""
    bright = BRIGHT_SHARE * float(np.nanmax(np.where(ok, found.amplitude, 0), initial=0))
    with np.errstate(invalid="ignore"):
        clear = found.amplitude > np.maximum(
            2 * AMPLITUDE_SIGMAS * _amplitude_sigma(count, variance), bright
        )
    return float(np.mean(~ok[clear])) if clear.any() else 0.0


def _amplitude_sigma(count: AnyArray, variance: Map) -> Map:
    """Standard error of an amplitude from so many samples."""
    return np.asarray(np.sqrt(2 * variance / np.maximum(count, 1)))
