"""Sinusoidal codes of projector columns and rows: periods, phases and what noise allows.

A picture of period P and shift s has the value 1/2 + 1/2 cos(2 pi x / P - s) in column x; a camera
pixel photographs it as A + B cos(2 pi x / P - s), A holding half of all scattered light.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
WIDTH = 1920  # the panel for which the periods below were chosen; others scale
SMALLEST_SCALE = 1 / 3  # periods under 16 px do not survive lenses
# Found by random search: over all columns and wrong candidates, the five last pictures differ by
# .85 of the amplitude at least, and the periods are about as short as 48 px allows.
MICRO_PERIODS = (54.83, 49.23, 49.31, 50.09, 50.12, 48.86)
MICRO_SHIFTS = (2.005, 3.482, 3.077, 4.532, 0.889)
HETERODYNE_PERIODS = (59.74, 58.05, 50.64)  # likewise; 1.08 apart
CANDIDATES = 6  # columns of a pixel that may get a closer look
CLOSE = 0.9  # they explain this share of what the best one does on a grid of half pixels
FIT_PARTS = ("x", "variance", "offset", "amplitude", "residual")


@dataclass(frozen=True, slots=True)
class Waves:
    """A set of K sinusoidal pictures along one axis; the first `base` share one period.

    Attributes
    ----------
    periods : (K,) [px]. shifts : (K,) [rad]. base : how many lead with the same period, at least 3.
    """

    periods: Array
    shifts: Array
    base: int

    @property
    def single(self) -> bool:
        """Whether all share one period, so that they cannot number their own fringes."""
        return bool(np.ptp(self.periods) == 0)

    def angles(self, x: ArrayLike) -> Array:
        """Phase (..., K) [rad] of each picture at columns x (...)."""
        return np.asarray(x, float)[..., None] * (2 * np.pi / self.periods) - self.shifts

    def kept(self, keep: NDArray[np.bool_]) -> "Waves":
        """The pictures (K,) that are left; the base must survive."""
        return Waves(self.periods[keep], self.shifts[keep], int(keep[: self.base].sum()))


def equal_steps(count: int) -> Array:
    """Shifts (count,) [rad] of an N-step set."""
    return 2 * np.pi * np.arange(count) / count


def period_scale(size: tuple[int, int]) -> float:
    """Factor on the periods for a panel of `size`: more pixels, wider stripes."""
    return max(SMALLEST_SCALE, max(size) / WIDTH)


def micro_waves(size: tuple[int, int]) -> Waves:
    """Micro phase shifting: 3 shifts of one period, then one picture for each of five more.

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
    """Values (length,) in 0..1 of one picture along its axis."""
    return 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(length) / period - shift)


def cramer_rao_variance(
    waves: Waves, x: ArrayLike, amplitude: ArrayLike, noise: ArrayLike
) -> Array:
    """Smallest variance [px^2] of x (...) that any unbiased decoder can reach.

    Offset, amplitude and column unknown. `amplitude` is B as photographed, (...) or (..., K) where
    blur takes more from short periods; `noise` (..., K) is the variance of each sample.
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
    """What lens and response make of the waves, alike all over one axis.

    Attributes
    ----------
    blur_px2 : variance of the blur [px^2]; it takes exp(-2 pi^2 v / P^2) of a wave of period P.
    harmonic : second harmonic before the blur, relative to the wave: what a wrong gamma leaves.
    """

    blur_px2: float = 0.0
    harmonic: float = 0.0

    def modulation(self, waves: Waves) -> Array:
        """Amplitude (K,) of each picture relative to the first."""
        return np.exp(-2 * np.pi**2 * self.blur_px2 * (waves.periods**-2 - waves.periods[0] ** -2))

    def harmonics(self, waves: Waves) -> Array:
        """Second harmonic (K,) of each picture relative to the first one's amplitude."""
        spread = 4 * waves.periods**-2 - waves.periods[0] ** -2
        return self.harmonic * np.exp(-2 * np.pi**2 * self.blur_px2 * spread)

    def depth(self, waves: Waves) -> float:
        """Share of the first picture's amplitude that the blur leaves."""
        return float(np.exp(-2 * np.pi**2 * self.blur_px2 * waves.periods[0] ** -2))


@dataclass(frozen=True, slots=True)
class WaveFit:
    """Least-squares fit of n pixels.

    Attributes
    ----------
    x : (n,) column [px]. variance : (n,) of x per unit of noise variance [px^2].
    offset, amplitude : (n,) A and B. residual : (n,) sum of squares that is left.
    """

    x: Array
    variance: Array
    offset: Array
    amplitude: Array
    residual: Array


def fit_waves(
    samples: Array, keep: NDArray[np.bool_], waves: Waves, look: WaveDistortion, x: Array
) -> WaveFit:
    """Fit A + B (m cos t + h cos 2t) to samples (n, K), of which `keep` (n, K) count, from x (n,)."""
    weight = keep.astype(float)
    samples = np.where(keep, samples, 0.0)
    curve, _ = _curve(waves, look, x)
    offset, amplitude = _line_fit(curve, samples, weight)
    for _ in range(3):
        jacobian, error = _local_model(waves, look, x, offset, amplitude, samples)
        normal = np.einsum("nki,nk,nkj->nij", jacobian, weight, jacobian)
        step = _solve(normal, np.einsum("nki,nk,nk->ni", jacobian, weight, error))
        offset, amplitude, x = offset + step[:, 0], amplitude + step[:, 1], x + step[:, 2]
    jacobian, error = _local_model(waves, look, x, offset, amplitude, samples)
    normal = np.einsum("nki,nk,nkj->nij", jacobian, weight, jacobian)
    variance = _solve(normal, np.broadcast_to([0.0, 0.0, 1.0], (len(x), 3)))[:, 2]
    return WaveFit(x, variance, offset, amplitude, np.sum(weight * error**2, axis=1))


def search_columns(
    samples: Array, keep: NDArray[np.bool_], waves: Waves, look: WaveDistortion, length: int
) -> tuple[WaveFit, Array]:
    """Best column of all for samples (n, K) of which only `keep` (n, K) count.

    Tries every half pixel, so it needs no base set, and refines the best few, which lie more than half
    a period apart. Also gives by how much the runner-up fits worse (n,) [sum of squares], infinite
    without one; waves of a single period tell the column only within it, and have none.
    """
    count, end = (1, waves.periods[0]) if waves.single else (CANDIDATES, length)
    grid, half = np.arange(-0.5, end, 0.5), int(waves.periods[0])
    near = np.arange(-half, half + 1)  # half a period to either side
    curve, _ = _curve(waves, look, grid)
    start, gained = np.zeros((2, count, len(samples)))
    for pattern in np.unique(keep, axis=0):
        rows = np.flatnonzero((keep == pattern).all(axis=1))
        for part in np.array_split(rows, max(1, rows.size * grid.size // 20_000_000)):
            gain = _explained(samples[np.ix_(part, pattern)], curve[:, pattern])
            every = np.arange(len(part))
            for x, top in zip(start, gained, strict=True):
                best = gain.argmax(axis=1)
                x[part], top[part] = grid[best], gain[every, best]
                gain[every[:, None], np.clip(best[:, None] + near, 0, grid.size - 1)] = 0.0
    fit = fit_waves(samples, keep, waves, look, start[0])
    best = np.stack([getattr(fit, name) for name in FIT_PARTS])
    runner_up = np.full(len(samples), np.inf)
    for x, top in zip(start[1:], gained[1:], strict=True):
        other = np.where(top > 0, fit.residual + gained[0] - top, np.inf)
        close = np.flatnonzero(top > CLOSE * gained[0])
        again = fit_waves(samples[close], keep[close], waves, look, x[close])
        other[close] = again.residual
        won = again.residual < best[-1, close]
        other[close[won]] = best[-1, close[won]]
        best[:, close[won]] = np.stack([getattr(again, name)[won] for name in FIT_PARTS])
        runner_up = np.minimum(runner_up, other)
    return WaveFit(*best), runner_up - best[-1]


def shared_sensitivity(
    samples: Array, waves: Waves, look: WaveDistortion, fit: WaveFit
) -> tuple[Array, Array, Array]:
    """What fits leave of samples (n, K), and what all pixels share would change of it.

    Returns residuals (n, K), their derivatives (2, n, K) by blur and by harmonic, and an orthonormal
    basis (3, n, K) of what the pixel's own offset, amplitude and column take up. Of that both are
    free already (variable projection).
    """
    value, slope = _curve(waves, look, fit.x)
    basis = _orthonormal(value, slope)
    angles = waves.angles(fit.x)
    bend, bend_2 = (
        -2 * np.pi**2 * (n**2 * waves.periods**-2 - waves.periods[0] ** -2) for n in (1, 2)
    )
    twice = np.cos(2 * angles)
    by_blur = (
        bend * look.modulation(waves) * np.cos(angles) + bend_2 * look.harmonics(waves) * twice
    )
    by_harmonic = WaveDistortion(look.blur_px2, 1.0).harmonics(waves) * twice
    amplitude = fit.amplitude[:, None]
    error = samples - fit.offset[:, None] - amplitude * value
    left, *shared = (
        _without(basis, v) for v in (error, amplitude * by_blur, amplitude * by_harmonic)
    )
    return left, np.stack(shared), basis


def _orthonormal(value: Array, slope: Array) -> Array:
    """Orthonormal basis (3, n, K) of an offset, a wave and its slope (n, K)."""
    basis = np.full((1, *value.shape), value.shape[1] ** -0.5)
    for vector in (value, slope):
        rest = _without(basis, vector)
        size = np.sqrt(np.einsum("nk,nk->n", rest, rest))
        basis = np.concatenate([basis, (rest / np.maximum(size, 1e-12)[:, None])[None]])
    return basis


def _without(basis: Array, vector: Array) -> Array:
    """Vectors (n, K) without their parts along a basis (b, n, K)."""
    for one in basis:
        vector = vector - np.einsum("nk,nk->n", one, vector)[:, None] * one
    return vector


def _curve(waves: Waves, look: WaveDistortion, x: Array) -> tuple[Array, Array]:
    """Normalised wave (n, K) at columns x (n,), and its slope per px."""
    angles = waves.angles(x)
    m, h = look.modulation(waves), look.harmonics(waves)
    value = m * np.cos(angles) + h * np.cos(2 * angles)
    slope = -(m * np.sin(angles) + 2 * h * np.sin(2 * angles)) * 2 * np.pi / waves.periods
    return value, slope


def _local_model(
    waves: Waves, look: WaveDistortion, x: Array, offset: Array, amplitude: Array, samples: Array
) -> tuple[Array, Array]:
    """Jacobian (n, K, 3) by offset, amplitude and column, and what is left of the samples."""
    value, slope = _curve(waves, look, x)
    jacobian = np.stack([np.ones_like(value), value, amplitude[:, None] * slope], axis=-1)
    return jacobian, samples - offset[:, None] - amplitude[:, None] * value


def _line_fit(curve: Array, samples: Array, weight: Array) -> tuple[Array, Array]:
    """Offset and amplitude (n,) of samples on a known curve, all (n, K)."""
    total = weight.sum(axis=1)
    mean_c, mean_s = (weight * curve).sum(1) / total, (weight * samples).sum(1) / total
    centred = curve - mean_c[:, None]
    power = np.maximum((weight * centred**2).sum(axis=1), 1e-12)
    amplitude = (weight * centred * samples).sum(axis=1) / power
    return mean_s - amplitude * mean_c, amplitude


def _explained(samples: Array, curve: Array) -> Array:
    """Squares (n, X) that the best offset and positive amplitude explain at each column."""
    centred = curve - curve.mean(axis=1, keepdims=True)
    unit = centred / np.maximum(np.linalg.norm(centred, axis=1, keepdims=True), 1e-9)
    return np.maximum((samples - samples.mean(axis=1, keepdims=True)) @ unit.T, 0.0) ** 2


def _solve(matrix: Array, vector: Array) -> Array:
    return np.asarray(_solve_many(matrix, vector[..., None])[..., 0])


def _solve_many(matrix: Array, columns: Array) -> Array:
    """Solutions (n, 3, M), with a whiff of damping: a singular pixel gets a huge variance."""
    damping = 1e-9 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] + 1e-30
    return np.linalg.solve(matrix + damping * np.eye(3), columns)
