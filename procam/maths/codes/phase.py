"""Sinusoidal codes of projector columns and rows: their periods, their fit and its error bound.

A pattern of period P and shift s has the value 1/2 + 1/2 cos(2 pi x / P - s) in column x. A camera
pixel sees it as A + B cos(2 pi x / P - s), where A contains half of the scattered light. The first
patterns of a code (its base) share one period, so their phase gives the column up to a whole number of
periods; the others identify which. `fit_waves` fits A, B and x by Gauss-Newton from a start;
`search_columns` finds the start among all columns. Defocus and a wrong gamma change all waves of an axis
alike (`WaveDistortion`); `shared_sensitivity` has the derivatives by which they are estimated from the
residuals of many pixels. The C kernel `kernels.search_phase` does the same for whole photographs.
The file is longer than 300 lines because the fit and its derivatives share one model of a wave.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from procam.arrays import Array, BoolArray

WIDTH = 1920  # of the panel for which the periods below were chosen; they scale with the width
SMALLEST_SCALE = 1 / 3  # lenses blur away periods under 16 px
# By random search among periods of 48 px or more: for any two columns a whole period apart, the five
# last patterns differ by 0.85 of the amplitude or more.
MICRO_PERIODS = (54.83, 49.23, 49.31, 50.09, 50.12, 48.86)
MICRO_SHIFTS = (2.005, 3.482, 3.077, 4.532, 0.889)
HETERODYNE_PERIODS = (59.74, 58.05, 50.64)  # found likewise; they differ by 1.08
CANDIDATES = 6  # columns of a pixel from which a fit may be started
CLOSE = 0.9  # of the squares explained by the best column of the grid: others are fitted too
GRID_CELLS = 20_000_000  # pixels times columns searched at a time: 160 MB
FIT_PARTS = ("x", "variance", "offset", "amplitude", "residual")


@dataclass(frozen=True, slots=True)
class Waves:
    """A set of K sinusoidal patterns along one axis; the first `base` share one period.

    Attributes
    ----------
    periods : (K,) [px]. shifts : (K,) [rad]. base : number of leading patterns of the same period.
    """

    periods: Array
    shifts: Array
    base: int

    @property
    def single(self) -> bool:
        """Whether all share one period, so that columns are known only within it."""
        return bool(np.ptp(self.periods) == 0)

    def angles(self, x: ArrayLike) -> Array:
        """Phase (..., K) [rad] of each pattern at columns x (...)."""
        return np.asarray(x, float)[..., None] * (2 * np.pi / self.periods) - self.shifts

    def kept(self, keep: BoolArray) -> "Waves":
        """The patterns that `keep` (K,) selects."""
        return Waves(self.periods[keep], self.shifts[keep], int(keep[: self.base].sum()))


def equal_steps(count: int) -> Array:
    """Shifts (count,) [rad] of an N-step set."""
    return 2 * np.pi * np.arange(count) / count


def period_scale(size: tuple[int, int]) -> float:
    """Factor on the periods for a panel of `size` (width, height) [px]."""
    return max(SMALLEST_SCALE, max(size) / WIDTH)


def micro_waves(size: tuple[int, int]) -> Waves:
    """Micro phase shifting: 3 shifts of one period, then one pattern for each of five more periods.

    Gupta & Nayar 2012, doi:10.1109/CVPR.2012.6247753.
    """
    first, *others = MICRO_PERIODS
    periods = period_scale(size) * np.array([first] * 3 + others)
    return Waves(periods, np.r_[equal_steps(3), MICRO_SHIFTS], 3)


def heterodyne_waves(size: tuple[int, int], steps: int = 4) -> Waves:
    """Three N-step sets of neighbouring periods, whose phases agree in one column only."""
    periods = period_scale(size) * np.repeat(HETERODYNE_PERIODS, steps)
    return Waves(periods, np.tile(equal_steps(steps), 3), steps)


def sine_line(length: int, period: float, shift: float) -> Array:
    """Values (length,) in 0..1 of one pattern along its axis, in linear light."""
    return 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(length) / period - shift)


def cramer_rao_variance(
    waves: Waves, x: ArrayLike, amplitude: ArrayLike, noise: ArrayLike
) -> Array:
    """Smallest variance [px^2] of x (...) that any unbiased decoder can reach (Cramer-Rao).

    Parameters
    ----------
    x : columns (...) [px]; offset, amplitude and column are unknown to the decoder.
    amplitude : B as photographed, (...) or, where blur attenuates short periods more, (..., K).
    noise : (..., K) variance of each sample.
    """
    angles = waves.angles(x)
    shape = angles.shape
    depth = np.asarray(amplitude, float)
    depth = depth[..., None] if depth.ndim < len(shape) else depth
    slope = -depth * np.sin(angles) * 2 * np.pi / waves.periods
    jacobian = np.stack([np.ones(shape), depth * np.cos(angles), slope], axis=-1)
    weight = 1 / np.broadcast_to(noise, shape)
    information = np.einsum("...ki,...k,...kj->...ij", jacobian, weight, jacobian)
    return np.asarray(np.linalg.inv(information)[..., 2, 2])


@dataclass(frozen=True, slots=True)
class WaveDistortion:
    """Effect of defocus and of a wrong gamma on the waves, the same for all pixels of an axis.

    Attributes
    ----------
    blur_px2 : variance v of the blur [px^2]; it leaves exp(-2 pi^2 v / P^2) of a wave of period P.
    harmonic : second harmonic before the blur, relative to the wave, caused by a wrong gamma.
    """

    blur_px2: float = 0.0
    harmonic: float = 0.0

    def modulation(self, waves: Waves) -> Array:
        """Amplitude (K,) of each pattern relative to the first."""
        return np.exp(-2 * np.pi**2 * self.blur_px2 * (waves.periods**-2 - waves.periods[0] ** -2))

    def harmonics(self, waves: Waves) -> Array:
        """Second harmonic (K,) of each pattern relative to the amplitude of the first."""
        spread = 4 * waves.periods**-2 - waves.periods[0] ** -2
        return self.harmonic * np.exp(-2 * np.pi**2 * self.blur_px2 * spread)

    def depth(self, waves: Waves) -> float:
        """Share of the amplitude of the first pattern that the blur leaves."""
        return float(np.exp(-2 * np.pi**2 * self.blur_px2 * waves.periods[0] ** -2))


@dataclass(frozen=True, slots=True)
class WaveFit:
    """Least-squares fit of n pixels.

    Attributes
    ----------
    x : (n,) column [px]. variance : (n,) of x per unit of noise variance [px^2].
    offset, amplitude : (n,) A and B. residual : (n,) sum of squared residuals.
    """

    x: Array
    variance: Array
    offset: Array
    amplitude: Array
    residual: Array


def fit_waves(samples: Array, waves: Waves, distortion: WaveDistortion, x: Array) -> WaveFit:
    """Fit A + B (m cos t + h cos 2t) to samples (n, K), from x (n,).

    m and h are the modulation and the harmonics of the distortion.
    """
    curve, _ = _curve(waves, distortion, x)
    offset, amplitude = _line_fit(curve, samples)
    for _ in range(3):
        jacobian, error = _local_model(waves, distortion, x, offset, amplitude, samples)
        normal = np.einsum("nki,nkj->nij", jacobian, jacobian)
        step = _solve(normal, np.einsum("nki,nk->ni", jacobian, error))
        offset, amplitude, x = offset + step[:, 0], amplitude + step[:, 1], x + step[:, 2]
    jacobian, error = _local_model(waves, distortion, x, offset, amplitude, samples)
    normal = np.einsum("nki,nkj->nij", jacobian, jacobian)
    variance = _solve(normal, np.broadcast_to([0.0, 0.0, 1.0], (len(x), 3)))[:, 2]
    return WaveFit(x, variance, offset, amplitude, np.sum(error**2, axis=1))


def search_columns(
    samples: Array, waves: Waves, distortion: WaveDistortion, length: int
) -> tuple[WaveFit, Array]:
    """Fits of samples (n, K), started from the best of all columns.

    The start is searched on a grid of half pixels, so no base is needed. The best few columns, more
    than half a period apart, are fitted. Waves of a single period are searched within that period.

    Returns
    -------
    fit : of the best column. margin : (n,) by which the second best fits worse [sum of squares];
        infinite without a second.
    """
    start, gained = _best_columns(samples, waves, distortion, length)
    fit = fit_waves(samples, waves, distortion, start[0])
    best = np.stack([getattr(fit, name) for name in FIT_PARTS])
    runner_up = np.full(len(samples), np.inf)
    for x, top in zip(start[1:], gained[1:], strict=True):
        other = np.where(top > 0, fit.residual + gained[0] - top, np.inf)
        close = np.flatnonzero(top > CLOSE * gained[0])
        again = fit_waves(samples[close], waves, distortion, x[close])
        other[close] = again.residual
        won = again.residual < best[-1, close]
        other[close[won]] = best[-1, close[won]]
        best[:, close[won]] = np.stack([getattr(again, name)[won] for name in FIT_PARTS])
        runner_up = np.minimum(runner_up, other)
    return WaveFit(*best), runner_up - best[-1]


def shared_sensitivity(
    samples: Array, waves: Waves, distortion: WaveDistortion, fit: WaveFit
) -> tuple[Array, Array, Array]:
    """Residuals of fits to samples (n, K), and their derivatives by the shared distortion.

    Returns the residuals (n, K), their derivatives (2, n, K) by blur and by harmonic, and an orthonormal
    basis (3, n, K) of the changes that the pixel's own offset, amplitude and column can make. Those
    changes are removed from the first two (variable projection).
    """
    value, slope = _curve(waves, distortion, fit.x)
    basis = _orthonormal(value, slope)
    once = np.cos(waves.angles(fit.x))
    twice = 2 * once**2 - 1  # of twice the angle
    bend, bend_2 = (
        -2 * np.pi**2 * (n**2 * waves.periods**-2 - waves.periods[0] ** -2) for n in (1, 2)
    )
    by_blur = (
        bend * distortion.modulation(waves) * once + bend_2 * distortion.harmonics(waves) * twice
    )
    by_harmonic = WaveDistortion(distortion.blur_px2, 1.0).harmonics(waves) * twice
    amplitude = fit.amplitude[:, None]
    error = samples - fit.offset[:, None] - amplitude * value
    residual, *shared = (
        _without(basis, v) for v in (error, amplitude * by_blur, amplitude * by_harmonic)
    )
    return residual, np.stack(shared), basis


def _orthonormal(value: Array, slope: Array) -> Array:
    """Orthonormal basis (3, n, K) of an offset, a wave and its slope (n, K)."""
    basis = np.full((1, *value.shape), value.shape[1] ** -0.5)
    for vector in (value, slope):
        rest = _without(basis, vector)
        size = np.sqrt(np.einsum("nk,nk->n", rest, rest))
        basis = np.concatenate([basis, (rest / np.maximum(size, 1e-12)[:, None])[None]])
    return basis


def _without(basis: Array, vector: Array) -> Array:
    """Vectors (n, K) less their projections on an orthonormal basis (b, n, K)."""
    for one in basis:
        vector = vector - np.einsum("nk,nk->n", one, vector)[:, None] * one
    return vector


def _best_columns(
    samples: Array, waves: Waves, distortion: WaveDistortion, length: int
) -> tuple[Array, Array]:
    """Columns (C, n) of a grid that explain most of the samples, and how much (C, n) [sum of squares]."""
    count, end = (1, waves.periods[0]) if waves.single else (CANDIDATES, length)
    grid, half = np.arange(-0.5, end, 0.5), int(waves.periods[0])
    near = np.arange(-half, half + 1)  # half a period to either side
    curve, _ = _curve(waves, distortion, grid)
    start, gained = np.zeros((2, count, len(samples)))
    rows = np.arange(len(samples))
    for part in np.array_split(rows, max(1, rows.size * grid.size // GRID_CELLS)):
        gain = _explained(samples[part], curve)
        every = np.arange(len(part))
        for x, top in zip(start, gained, strict=True):
            best = gain.argmax(axis=1)
            x[part], top[part] = grid[best], gain[every, best]
            gain[every[:, None], np.clip(best[:, None] + near, 0, grid.size - 1)] = 0.0
    return start, gained


def _curve(waves: Waves, distortion: WaveDistortion, x: Array) -> tuple[Array, Array]:
    """Normalised wave (n, K) at columns x (n,), and its slope per px."""
    angles = waves.angles(x)
    m, h = distortion.modulation(waves), distortion.harmonics(waves)
    across, along = np.sin(angles), np.cos(angles)
    value = (m + 2 * h * along) * along - h  # m cos t + h cos 2t
    slope = -(m + 4 * h * along) * across * (2 * np.pi / waves.periods)
    return value, slope


def _local_model(
    waves: Waves,
    distortion: WaveDistortion,
    x: Array,
    offset: Array,
    amplitude: Array,
    samples: Array,
) -> tuple[Array, Array]:
    """Jacobian (n, K, 3) by offset, amplitude and column, and the residuals (n, K)."""
    value, slope = _curve(waves, distortion, x)
    jacobian = np.stack([np.ones_like(value), value, amplitude[:, None] * slope], axis=-1)
    return jacobian, samples - offset[:, None] - amplitude[:, None] * value


def _line_fit(curve: Array, samples: Array) -> tuple[Array, Array]:
    """Offset and amplitude (n,) of samples on a known curve, both (n, K)."""
    mean_c, mean_s = curve.mean(axis=1), samples.mean(axis=1)
    centred = curve - mean_c[:, None]
    power = np.maximum((centred**2).sum(axis=1), 1e-12)
    amplitude = (centred * samples).sum(axis=1) / power
    return mean_s - amplitude * mean_c, amplitude


def _explained(samples: Array, curve: Array) -> Array:
    """Sum of squares (n, X) that the best offset and positive amplitude explain at each column."""
    centred = curve - curve.mean(axis=1, keepdims=True)
    unit = centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-9)
    return np.maximum((samples - samples.mean(axis=1, keepdims=True)) @ unit.T, 0.0) ** 2


def _solve(matrix: Array, vector: Array) -> Array:
    """Solutions (n, 3), slightly damped, so that a singular pixel gets a huge variance."""
    damping = 1e-9 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] + 1e-30
    return np.asarray(np.linalg.solve(matrix + damping * np.eye(3), vector[..., None])[..., 0])
