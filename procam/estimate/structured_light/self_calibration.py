"""What a set of sinusoidal pictures tells of lens, response, scattered light and noise (science.md s.2).

Four things bias or blur columns alike over the whole picture, and are read off what the fits of some
forty thousand pixels leave: how much blur takes from each period, what a wrong gamma adds, by how
much each picture's flux differs from half of white's, and how noise grows with light.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam import kernels
from procam.errors import NotEnoughData
from procam.estimate.camera.noise import NO_NOISE, NoiseLaw
from procam.maths.codes.phase import (
    FIT_PARTS,
    WaveDistortion,
    WaveFit,
    Waves,
    search_columns,
    shared_sensitivity,
)

Array = NDArray[np.float64]
Map = NDArray[np.float32]
Mask = NDArray[np.bool_]
Samples = NDArray[Any]
SAMPLE_PIXELS = 40_000
FEWEST_PIXELS = 50
UNKNOWNS = 3  # offset, amplitude, column
ROUNDS = 4
PRIOR_BLUR_PX2, PRIOR_HARMONIC, PRIOR_SURPLUS = 20.0, 0.1, 0.02  # of this size, if any
LARGEST_BLUR_PX2, LARGEST_HARMONIC = 100.0, 0.3
FAINT_SHARE = 0.1  # of a bright pixel's amplitude: below, nothing shines there directly
LEVELS = 12


@dataclass(frozen=True, slots=True)
class SelfCalibration:
    """What all pixels of one axis share; `surplus` (K,) is each picture's flux beyond half of white's."""

    look: WaveDistortion
    surplus: Array
    noise: NoiseLaw


def self_calibrate(
    frames: Sequence[Samples],
    waves: Waves,
    length: int,
    span: Map,
    usable: Mask,
    variance: Map | None = None,
    surplus_sigma: float = PRIOR_SURPLUS,
) -> SelfCalibration:
    """Read lens, response, surplus and noise off K pictures (H, W).

    `span` (H, W) is white - black; `usable` (H, W) marks pixels to look at; `variance` (H, W) of a
    sample is for pictures whose noise follows no law of their level, and makes theirs the unit of
    the law that is found; `surplus_sigma` is how large a surplus may be. Gauss-Newton with each
    pixel's offset, amplitude and column eliminated. The surplus is the phasor by which scattered
    light biases columns: it adds that share of a pixel's scattered light to the picture.
    """
    where = np.flatnonzero(usable)
    if where.size < FEWEST_PIXELS:
        raise NotEnoughData(
            f"waves: got {where.size} pixels with light and no saturated sample, expected at least "
            f"{FEWEST_PIXELS}; is the projector on, and the exposure right?"
        )
    where = where[:: max(1, where.size // SAMPLE_PIXELS)]
    raw = np.stack([np.ravel(f)[where] for f in frames], axis=1).astype(float)
    full = np.ravel(span)[where].astype(float)
    if variance is not None:
        scale = 1 / np.sqrt(np.ravel(variance)[where].astype(float))
        raw, full = raw * scale[:, None], full * scale
    look, surplus, scattered = WaveDistortion(), np.zeros(len(frames)), np.zeros(len(where))
    for _ in range(ROUNDS):
        samples = raw - scattered[:, None] * surplus
        fit, seen = _fitted(samples, waves, look, length)
        scattered[seen] = np.maximum(full[seen] - 2 / look.depth(waves) * fit.amplitude, 0)
        now = SelfCalibration(look, surplus, NO_NOISE)
        look, surplus = _step(samples[seen], waves, now, fit, (scattered[seen], surplus_sigma))
    fit, _ = _fitted(raw - scattered[:, None] * surplus, waves, look, length)
    return SelfCalibration(look, surplus, _noise_law(fit, len(frames) - UNKNOWNS))


def _fitted(
    samples: Array, waves: Waves, look: WaveDistortion, length: int
) -> tuple[WaveFit, Mask]:
    """Fit of the samples (n, K) in which a wave is seen, and which (n,) these are."""
    found = find_columns(list(np.ascontiguousarray(samples.T, np.float32)), waves, look, length)
    seen = np.isfinite(found.position)
    if seen.sum() < FEWEST_PIXELS:
        raise NotEnoughData(
            f"waves: got {seen.sum()} pixels in which they move, expected at least {FEWEST_PIXELS}; "
            "did the projector freeze on one picture?"
        )
    parts = (found.position, found.variance, found.offset, found.amplitude, found.residual)
    return WaveFit(*(part[seen].astype(float) for part in parts)), seen


def find_columns(
    frames: Sequence[Samples], waves: Waves, look: WaveDistortion, length: int
) -> kernels.PhaseFit:
    """Best column of every pixel; waves of a single period tell it only within that period.

    Without a base set of three pictures, all columns are tried for each pixel.
    """
    if waves.single:
        length = 1
    if waves.base >= UNKNOWNS:
        modulation, harmonics = look.modulation(waves), look.harmonics(waves)
        return kernels.search_phase(
            frames, waves.periods, waves.shifts, modulation, harmonics, waves.base, length
        )
    samples = np.stack([np.ravel(f) for f in frames], axis=1).astype(float)
    fit, margin = search_columns(samples, np.ones(samples.shape, bool), waves, look, length)
    parts = (fit.x, fit.variance, fit.amplitude, fit.offset, fit.residual, margin)
    return kernels.PhaseFit(*(p.reshape(frames[0].shape).astype(np.float32) for p in parts))


def _step(
    samples: Array,
    waves: Waves,
    now: SelfCalibration,
    fit: WaveFit,
    flux: tuple[Array, float],
) -> tuple[WaveDistortion, Array]:
    """One Gauss-Newton step of look and surplus; `flux`: scattered light (n,), size of surplus."""
    honest, surplus_sigma = _honest(fit), flux[1]
    fit = WaveFit(*(getattr(fit, name)[honest] for name in FIT_PARTS))
    left, by_look, basis = shared_sensitivity(samples[honest], waves, now.look, fit)
    matrix, gradient = _shared_equations(left, by_look, basis, flux[0][honest])
    noise = max(float(np.mean(left**2)), 1e-20)
    values = np.r_[now.look.blur_px2, now.look.harmonic, now.surplus]
    size = np.r_[PRIOR_BLUR_PX2, PRIOR_HARMONIC, np.full(len(now.surplus), surplus_sigma)]
    gradient = gradient / noise - values / size**2
    values = values + np.linalg.solve(matrix / noise + np.diag(size**-2), gradient)
    blur_px2 = float(np.clip(values[0], 0.0, LARGEST_BLUR_PX2))
    return WaveDistortion(
        blur_px2, float(np.clip(values[1], -LARGEST_HARMONIC, LARGEST_HARMONIC))
    ), values[2:]


def _shared_equations(
    left: Array, by_look: Array, basis: Array, scattered: Array
) -> tuple[Array, Array]:
    """Normal matrix (2 + K, 2 + K) and gradient by blur, harmonic and each picture's surplus.

    A surplus adds that share of the scattered light (n,) to one picture: of which the pixel's own
    fit takes up what lies along its basis.
    """
    count = left.shape[1]
    taken = (basis * scattered[:, None]).transpose(2, 0, 1).reshape(count, -1)
    by_flux = np.sum(scattered**2) * np.eye(count) - taken @ taken.T
    both = np.einsum("ink,n->ik", by_look, scattered)
    own = np.einsum("ink,jnk->ij", by_look, by_look)
    matrix = np.block([[own, both], [both.T, by_flux]])
    return matrix, np.r_[np.einsum("ink,nk->i", by_look, left), scattered @ left]


def _honest(fit: WaveFit) -> Mask:
    """Pixels with a clear wave that the model explains: no edges, no mixtures, no unlit ones."""
    bright = fit.amplitude > FAINT_SHARE * np.quantile(fit.amplitude, 0.9)
    if not bright.any():
        return np.isfinite(fit.residual)
    return np.asarray(bright & (fit.residual <= 6 * np.median(fit.residual[bright]) + 1e-12))


def _noise_law(fit: WaveFit, freedom: int) -> NoiseLaw:
    """Line through the mean residual variance of pixels sorted by level; no part negative."""
    honest = _honest(fit)
    level, variance = fit.offset[honest], fit.residual[honest] / freedom
    parts = [p for p in np.array_split(np.argsort(level), LEVELS) if p.size]
    levels = np.array([level[p].mean() for p in parts])
    means = np.maximum([variance[p].mean() for p in parts], 1e-12)
    if np.ptp(levels) == 0:
        return NoiseLaw(float(variance.mean()), 0.0)
    slope, start = np.polyfit(levels, means, 1, w=1 / means)
    if slope <= 0:
        return NoiseLaw(float(variance.mean()), 0.0)
    if start < 0:
        return NoiseLaw(0.0, float(np.mean(variance) / np.mean(level)))
    return NoiseLaw(float(start), float(slope))
