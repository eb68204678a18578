"""Sinusoidal pictures of one axis to columns, with a standard error that holds (science.md s.2)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.structured_light.self_calibration import (
    PRIOR_SURPLUS,
    UNKNOWNS,
    SelfCalibration,
    find_columns,
    self_calibrate,
)
from procam.kernels import PhaseFit
from procam.maths.codes.phase import WaveDistortion, Waves

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]
Samples = NDArray[Any]
MIN_SAMPLES = 5  # samples left: two more than unknowns, or nothing could check them
NEGLIGIBLE_SURPLUS = 1e-4  # of the flux: less moves no column by .01 px
MOST_SLOW = 60_000  # pixels with no base set left, each of which takes a search over all columns
AMPLITUDE_SIGMAS = 5.0
MARGIN_SIGMAS2 = 12.0  # a wrong fringe fits worse by this much, or the pixel is dropped
MISFIT_SIGMAS2 = 35.0  # beyond the expected sum of squares: never, for a pixel that obeys the model


def complete_base_set(
    frames: dict[int, Samples], base: int, white: Samples, black: Samples
) -> dict[int, Samples]:
    """Pictures by number, with one lost of the three that begin made up.

    Equal steps add up to white and black. With no picture lost, or more, or another base: as it is.
    """
    there = [frames[i] for i in range(base) if i in frames]
    if base != UNKNOWNS or len(there) != base - 1:
        return frames
    (lost,) = set(range(base)) - set(frames)
    total = base / 2 * (white.astype(np.float32) + black)
    made_up = np.asarray(total - np.sum(there, axis=0, dtype=np.float32), np.float32)
    return {i: f.astype(np.float32) for i, f in frames.items()} | {lost: made_up}


@dataclass(frozen=True, slots=True)
class SinusoidImages:
    """The pictures of one axis as photographed.

    Attributes
    ----------
    frames : K photographs (H, W). waves : their waves. length : columns on the panel.
    span : (H, W) white - black. usable : (H, W) pixels to calibrate on.
    dropped : K masks (H, W) of saturated or dark samples.
    variance : (H, W) of a sample, for merged exposures; None to read a noise law off the pictures.
    surplus_sigma : how far the pictures' fluxes may be from half of white's, as a share of it.
    """

    frames: Sequence[Samples]
    waves: Waves
    length: int
    span: Map
    usable: Mask
    dropped: Sequence[Mask]
    variance: Map | None = None
    surplus_sigma: float = PRIOR_SURPLUS


@dataclass(frozen=True, slots=True)
class SinusoidResult:
    """One axis.

    Attributes
    ----------
    x, sigma : (H, W) column [px] and its standard error; NaN where not known.
    amplitude : (H, W) B, what half the direct light is without blur [image unit].
    look, noise : what lens, response and camera were found to do. period_px : mean of the waves.
    """

    x: Map
    sigma: Map
    amplitude: Map
    look: WaveDistortion
    noise: NoiseLaw
    period_px: float


def decode_sinusoids(pictures: SinusoidImages) -> SinusoidResult:
    """Columns of one axis; pixels with dropped samples are decoded from five others or more."""
    waves, frames = pictures.waves, pictures.frames
    short = np.logical_or.reduce(pictures.dropped)
    usable = pictures.usable & ~short
    known = self_calibrate(
        frames,
        waves,
        pictures.length,
        pictures.span,
        usable,
        pictures.variance,
        pictures.surplus_sigma,
    )
    found = find_columns(frames, waves, known.look, pictures.length)
    if np.abs(known.surplus).max() > NEGLIGIBLE_SURPLUS:
        frames = _balanced(pictures, known, found)
        found = find_columns(frames, waves, known.look, pictures.length)
    count = np.full(usable.shape, len(frames))
    if short.any():
        count -= np.sum(pictures.dropped, axis=0)
        _search_rest(
            pictures, frames, known.look, short & pictures.usable & (count >= MIN_SAMPLES), found
        )
    noise = pictures.variance
    if noise is None:
        noise = known.noise.variance(found.offset)
    ok = _trusted(found, count, noise)
    sigma = np.sqrt(np.where(ok, found.variance * noise, np.nan))
    amplitude = np.where(short & ~ok, 0.0, found.amplitude) / known.look.depth(waves)
    return SinusoidResult(
        np.where(ok, found.position, np.nan).astype(np.float32),
        sigma.astype(np.float32),
        np.nan_to_num(amplitude).astype(np.float32),
        known.look,
        known.noise,
        float(waves.periods.mean()),
    )


def _balanced(
    pictures: SinusoidImages, known: SelfCalibration, found: PhaseFit
) -> list[NDArray[np.float32]]:
    """The photographs without what their surplus flux adds to the scattered light."""
    direct = 2 / known.look.depth(pictures.waves) * np.nan_to_num(found.amplitude)
    scattered = np.maximum(pictures.span - direct, 0)
    return [
        frame - np.float32(surplus) * scattered
        for frame, surplus in zip(pictures.frames, known.surplus, strict=True)
    ]


def _search_rest(
    pictures: SinusoidImages,
    frames: Sequence[Samples],
    look: WaveDistortion,
    rows: Mask,
    found: PhaseFit,
) -> None:
    """Put the answer for pixels `rows` (H, W) with missing samples into `found`, in place."""
    samples = np.stack([f[rows] for f in frames], axis=1).astype(np.float32)
    keep = ~np.stack([d[rows] for d in pictures.dropped], axis=1)
    answers = np.full((len(found), len(samples)), np.nan, np.float32)
    for pattern in np.unique(keep, axis=0):
        some = np.flatnonzero((keep == pattern).all(axis=1))
        waves = pictures.waves.kept(pattern)
        if waves.base < UNKNOWNS and not waves.single:
            some = some[: max(0, MOST_SLOW - int(np.isfinite(answers[0]).sum()))]
        if not some.size:
            continue
        columns = list(np.ascontiguousarray(samples[np.ix_(some, pattern)].T))
        answers[:, some] = np.stack(find_columns(columns, waves, look, pictures.length))
    for whole, answer in zip(found, answers, strict=True):
        whole[rows] = answer


def _trusted(found: PhaseFit, count: NDArray[Any], variance: Map) -> Mask:
    """Pixels (H, W) whose wave is clear, alone and well fitted, given a sample's variance."""
    with np.errstate(invalid="ignore"):
        ok = found.amplitude > AMPLITUDE_SIGMAS * np.sqrt(2 * variance / np.maximum(count, 1))
        ok &= found.margin >= MARGIN_SIGMAS2 * variance
        ok &= found.residual <= (count - UNKNOWNS + MISFIT_SIGMAS2) * variance
        ok &= np.isfinite(found.position) & (count >= MIN_SAMPLES)
    return np.asarray(ok)
