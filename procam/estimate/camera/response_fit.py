"""The fit of a camera's inverse response to levels of one scene at several exposures.

Unknown are the curve, the shutter times within their tolerance, and the brightness of every block of
pixels. The logarithm of the curve's slope is a cubic spline of the level, so the curve always rises.
The residuals are observed minus predicted levels, where the noise is; fits of the light itself, as by
Debevec and Malik 1997 (doi:10.1145/258734.258884) and Mitsunaga and Nayar 1999
(doi:10.1109/CVPR.1999.786966), are biased by noise. The loss is Huber's. The brightnesses are
eliminated from the normal equations of a Gauss-Newton iteration. Every step selects the samples anew,
without those that noise could have clipped, and estimates their noise. The cost therefore changes from
step to step, so there is no damping by it as in `maths.levenberg`; long steps are shortened instead.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from procam.arrays import Array, BoolArray, IndexArray
from procam.maths.statistics import robust_sigma

SHUTTER_SIGMA = 0.02  # relative: headers say 1/60 and 1/125, shutters do 1/64 and 1/128
SPLINE_INTERVALS = 12
GRID = 1025  # levels at which the curve is tabulated
BEND_SIGMA = 0.25  # prior of the spline's second differences, for levels without samples
COEFFICIENT_SIGMA = 100.0  # weak prior that keeps the equations regular without samples
END_SHARE = (
    0.8  # knots crowd at black; white gets this share of it, since tone curves roll off there
)
DARK_SIGMAS, WHITE_SIGMAS = (
    6.0,
    2.5,
)  # of pixel noise, from an end of the range to the levels in use
MIN_MARGIN, MAX_MARGIN = 0.005, 0.05  # of the range, between an end and the levels in use
NEAR_END = 0.06  # of the range, in which the noise near an end is estimated
SELECTIONS, ROUNDS = 20, 50  # steps with new selections, of all; afterwards the selection is fixed
MAX_STEP, NEGLIGIBLE_STEP = 0.5, 1e-4  # of logarithms
HUBER = 2.5  # standard errors from which the loss is linear
NOISE_GROUPS, MIN_IN_GROUP = 20, 50  # of samples by level, for their noise
MIN_NOISE = 1e-6


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means of N squares of `edge` pixels in J photographs.

    `level` (J, N) 0..1, `deviation` (J, N) of their pixels, `sound` (J, N) where no pixel is clipped.
    """

    edge: int
    level: Array
    deviation: Array
    sound: BoolArray

    def take(self, chosen: IndexArray) -> "Blocks":
        """Some of the blocks."""
        parts = (self.level, self.deviation, self.sound)
        return Blocks(self.edge, *(part[:, chosen] for part in parts))  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class _Curve:
    """Unscaled inverse response on a grid of levels: its slope is exp(basis @ bends)."""

    levels: Array
    basis: Array
    bends: Array

    @property
    def slope(self) -> Array:
        """Derivative of the light by the level (G,)."""
        return np.exp(self.basis @ self.bends)

    def light(self) -> Array:
        """Light (G,)."""
        return self._integral(self.slope[:, None])[:, 0]

    def by_bends(self) -> Array:
        """Derivatives (G, P) of the light."""
        return self._integral(self.slope[:, None] * self.basis)

    def _integral(self, values: Array) -> Array:
        steps = np.diff(self.levels)[:, None] / 2
        summed = np.cumsum((values[1:] + values[:-1]) * steps, axis=0)
        return np.vstack([np.zeros(summed.shape[1]), summed])


def _initial_curve() -> _Curve:
    """A gamma of 2, with dense knots near black and white, where curves bend most."""
    uniform = np.linspace(0, 1, GRID)
    levels = (1 - END_SHARE) * uniform**2 + END_SHARE * np.sin(np.pi / 2 * uniform) ** 2
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPLINE_INTERVALS + 1), np.ones(3)])
    basis = BSpline.design_matrix(uniform, knots, 3).toarray()
    bends = np.linalg.lstsq(basis, np.log(levels + 0.01), rcond=None)[0]
    # the last one is fixed, since a common factor of light and brightness is free
    return _Curve(levels, basis[:, :-1], (bends - bends[-1])[:-1])


@dataclass(frozen=True, slots=True)
class _ResponseEquations:
    """Normal equations of P bends and shutter times, with N brightnesses eliminated.

    `matrix` (P, P) and `right` (P,); `cross` (N, P), `own` (N,) and `own_right` (N,) of the brightnesses.
    """

    matrix: Array
    right: Array
    cross: Array
    own: Array
    own_right: Array

    def step(self) -> tuple[Array, Array]:
        """Gauss-Newton steps (P,) of bends and shutter times and (N,) of brightnesses, shortened."""
        shared = np.asarray(np.linalg.solve(self.matrix, self.right), float)
        own = (self.own_right - self.cross @ shared) / self.own
        shorter = min(1.0, MAX_STEP / max(float(np.abs(shared).max()), 1e-12))
        return shorter * shared, np.clip(shorter * own, -MAX_STEP, MAX_STEP)


class CameraResponseFit:
    """The least-squares problem with its selection of samples and its unknowns.

    Attributes
    ----------
    blocks : the levels. nominal : (J,) logarithms of the nominal exposures.
    curve, shutter, brightness : the unknowns; (J,) and (N,) are logarithms.
    predicted : (J, N) levels. use : (J, N) the selected samples. noise : (J, N) their sigma.
    converged : whether the last step was negligible.
    """

    def __init__(self, blocks: Blocks, seconds: Array) -> None:
        self.blocks = blocks
        self.nominal = np.log(seconds)
        self.shutter = self.nominal.copy()
        self.curve = _initial_curve()
        self.brightness = self._initial_brightness()
        self.predicted = blocks.level
        self.use = blocks.sound
        self.noise = np.full_like(blocks.level, 0.01)
        self.converged = False

    def solve(self) -> None:
        """Iterate until a step is negligible, or for `ROUNDS` steps."""
        for number in range(ROUNDS):
            self._predict()
            if number < SELECTIONS:
                self._select()
            shared, own = self._equations().step()
            bends = len(self.curve.bends)
            self.curve = replace(self.curve, bends=self.curve.bends + shared[:bends])
            self.shutter += shared[bends:]
            self.brightness += own
            self.converged = float(np.abs(shared).max()) < NEGLIGIBLE_STEP
            if self.converged:
                break
        self._predict()
        self._select()

    @property
    def exposures_s(self) -> Array:
        """Fitted exposures (J,) [s]."""
        return np.exp(self.shutter)

    def table(self, levels: Array) -> tuple[Array, Array]:
        """Light (K,) at levels (K,), 1 at level 1, and its standard errors (K,)."""
        curve = self.curve
        light, by_bend, count = curve.light(), curve.by_bends(), len(curve.bends)
        covariance = np.linalg.inv(self._equations().matrix)[:count, :count]
        change = (by_bend - np.outer(light, by_bend[-1]) / light[-1]) / light[-1]
        variance = np.einsum("gp,pq,gq->g", change, covariance, change)
        sigma = np.sqrt(np.maximum(variance, 0))
        grid = curve.levels
        return np.interp(levels, grid, light / light[-1]), np.interp(levels, grid, sigma)

    def residual(self) -> Array:
        """Observed minus predicted levels (J, N)."""
        return np.asarray(self.blocks.level - self.predicted)

    def residual_rms(self) -> float:
        """Rms residual of the selected samples, as a share of the range [-]."""
        return float(np.sqrt(np.mean(self.residual()[self.use] ** 2)))

    def _initial_brightness(self) -> Array:
        light = np.interp(self.blocks.level, self.curve.levels, self.curve.light())
        rate = np.log(np.maximum(light, 1e-9)) - self.nominal[:, None]
        weight = self.blocks.sound * self.blocks.level + 1e-9
        return np.asarray(np.average(rate, axis=0, weights=weight))

    def _predict(self) -> None:
        light = np.exp(self.brightness + self.shutter[:, None])
        self.predicted = np.interp(light, self.curve.light(), self.curve.levels)

    def _select(self) -> None:
        """Select the samples and estimate their noise."""
        low, high = self._limits()
        self.use = self.blocks.sound & (self.predicted > low) & (self.predicted < high)
        self.use &= self.use.sum(axis=0) >= 2
        self.noise = self._noise_by_level()

    def _limits(self) -> tuple[float, float]:
        """Levels between which noise is not clipped nor, near black, distorted by the curve."""
        margins = []
        for sigmas, level in ((DARK_SIGMAS, self.predicted), (WHITE_SIGMAS, 1 - self.predicted)):
            near = self.noise[self.use & (level < NEAR_END)]
            noise = self.blocks.edge * float(np.median(near)) if near.size else MAX_MARGIN
            margins.append(float(np.clip(sigmas * noise, MIN_MARGIN, MAX_MARGIN)))
        return margins[0], 1 - margins[1]

    def _noise_by_level(self) -> Array:
        """Robust sigma of the residuals (J, N), interpolated over the predicted level."""
        residual, level = self.residual()[self.use], self.predicted[self.use]
        middles, sigmas = [0.5], [robust_sigma(residual, 0.0) if residual.size else 1.0]
        for group in np.array_split(np.argsort(level), NOISE_GROUPS):
            if group.size >= MIN_IN_GROUP:
                middles.append(float(level[group].mean()))
                sigmas.append(robust_sigma(residual[group], 0.0))
        order = np.argsort(middles)
        table = np.maximum(np.array(sigmas)[order], MIN_NOISE)
        return np.interp(self.predicted, np.array(middles)[order], table)

    def _equations(self) -> _ResponseEquations:
        curve = self.curve
        levels, slope, light, by_bends = curve.levels, curve.slope, curve.light(), curve.by_bends()
        photos, blocks = self.use.shape
        bends = by_bends.shape[1]
        total = bends + photos
        matrix, right = np.zeros((total, total)), np.zeros(total)
        cross, own, own_right = np.zeros((blocks, total)), np.zeros(blocks), np.zeros(blocks)
        for j, level in enumerate(self.predicted):
            residual, steepness = self.blocks.level[j] - level, np.interp(level, levels, slope)
            # the shutter time acts as the brightness does
            by_brightness = np.interp(level, levels, light) / steepness
            rows = _interpolated(level, levels, -by_bends) / steepness[:, None]
            weight = self.use[j] / self.noise[j] ** 2
            weight /= np.maximum(np.abs(residual) / (HUBER * self.noise[j]), 1)
            weighted = weight * by_brightness
            matrix[:bends, :bends] += rows.T @ (weight[:, None] * rows)
            matrix[:bends, bends + j] = matrix[bends + j, :bends] = rows.T @ weighted
            matrix[bends + j, bends + j] = weighted @ by_brightness
            right[:bends] += rows.T @ (weight * residual)
            right[bends + j] = weighted @ residual
            cross[:, :bends] += weighted[:, None] * rows
            cross[:, bends + j] = weighted * by_brightness
            own += weighted * by_brightness
            own_right += weighted * residual
        own = np.maximum(own, 1e-12)
        matrix -= (cross / own[:, None]).T @ cross
        right -= cross.T @ (own_right / own)
        self._add_priors(matrix, right)
        return _ResponseEquations(matrix, right, cross, own, own_right)

    def _add_priors(self, matrix: Array, right: Array) -> None:
        bends, count = self.curve.bends, len(self.curve.bends)
        second = np.diff(np.eye(count + 1), 2, axis=0)[:, :-1] / BEND_SIGMA  # the last bend is 0
        matrix[:count, :count] += second.T @ second
        matrix[:count, :count] += np.eye(count) / COEFFICIENT_SIGMA**2
        right[:count] -= second.T @ (second @ bends) + bends / COEFFICIENT_SIGMA**2
        matrix[count:, count:] += np.eye(len(self.nominal)) / SHUTTER_SIGMA**2
        right[count:] -= (self.shutter - self.nominal) / SHUTTER_SIGMA**2


def _interpolated(at: Array, grid: Array, rows: Array) -> Array:
    """Rows (G, P) at the places of a rising grid (G,), interpolated at other places (N,)."""
    low = np.clip(np.searchsorted(grid, at) - 1, 0, len(grid) - 2)
    share = ((at - grid[low]) / (grid[low + 1] - grid[low]))[:, None]
    return np.asarray(rows[low] * (1 - share) + rows[low + 1] * share)
