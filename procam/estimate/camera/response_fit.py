"""The fit of a camera's inverse response to levels of one scene at several exposures.

Unknown are the curve, the shutter times within their tolerance, and the brightness of every block of
pixels (docs/theory/photometry.md (R3)). The logarithm of the curve's slope is a cubic spline of the level, so
the curve always rises. Its knots are dense enough for a knee; how far it may bend is found from the levels.
The residuals are observed minus predicted levels, where the noise is; fits of the light itself, as by
Debevec and Malik 1997 (doi:10.1145/258734.258884) and Mitsunaga and Nayar 1999
(doi:10.1109/CVPR.1999.786966), are biased by noise. The loss is Huber's. The brightnesses are
eliminated from the normal equations of a Gauss-Newton iteration. Every step selects the samples anew,
without those that noise could have clipped, and estimates their noise. The cost therefore changes from
step to step, so there is no damping by it as in `maths.levenberg`; long steps are shortened instead.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from procam.arrays import Array, BoolArray, IndexArray
from procam.estimate.camera.response_curve import initial_curve, second_differences
from procam.maths.statistics import robust_sigma

SHUTTER_SIGMA = 0.02  # relative: headers say 1/60 and 1/125, shutters do 1/64 and 1/128
# toes of all kinds bend beside black: this share of the knots has a prior wider by this factor
DARK_SHARE, DARK_WIDTH = 0.15, 2.5
# prior of the second differences of the spline's coefficients about those of a gamma of 2: at the start,
# and the range in which the photographs set it
BEND_SIGMA, BEND_SIGMAS = 0.1, (0.01, 1.0)
COEFFICIENT_SIGMA = 100.0  # weak prior that keeps the equations regular without samples
# of pixel noise, from an end of the range to the levels in use; levels nearer to white are
# biased, since 254.5 of 255 is clipped already
DARK_SIGMAS, WHITE_SIGMAS = 6.0, 3.75
ALONE_SIGMAS = 2.0  # of a level as predicted by the other photographs
FREEDOM = (
    30.0  # degrees of freedom of the prior of bends; with 8 it was too narrow for a knee at 2 stops
)
# of a sample that the others of its block predict, and whose residual estimates noise
MAX_LEVERAGE = 0.9
MIN_MARGIN, MAX_MARGIN = 0.005, 0.05  # of the range, between an end and the levels in use
NEAR_END = 0.06  # of the range, in which the noise near an end is estimated
# step that first selects by predicted levels, those of the first steps are too far off
FIRST_SELECTION = 5
SELECTIONS, ROUNDS = 25, 80  # steps with new selections, of all; afterwards the selection is fixed
FIRST_MOVED = 15  # step from which blocks that moved are left out
MOVED_SIGMAS, MOVED_LEVEL = 6.0, 0.015  # of a residual, and share of the range, of such a block
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

    def photographs(self, chosen: IndexArray) -> "Blocks":
        """The blocks in some of the photographs."""
        return Blocks(self.edge, self.level[chosen], self.deviation[chosen], self.sound[chosen])

    def take(self, chosen: IndexArray) -> "Blocks":
        """Some of the blocks."""
        parts = (self.level, self.deviation, self.sound)
        return Blocks(self.edge, *(part[:, chosen] for part in parts))  # type: ignore[arg-type]


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
        self.curve = initial_curve()
        self.start = self.curve.bends
        self.brightness = self._initial_brightness()
        self.predicted = blocks.level
        self.use = blocks.sound
        self.moved = np.zeros(blocks.level.shape[1], bool)
        self.noise = np.full_like(blocks.level, 0.01)
        self.scale = BEND_SIGMA
        knots = np.linspace(0, 1, len(self.start) - 1)
        self.widths = np.where(knots < DARK_SHARE, DARK_WIDTH, 1.0)
        self.bend_sigma = BEND_SIGMA * self.widths
        self.converged = False

    def solve(self) -> None:
        """Iterate until a step is negligible, or for `ROUNDS` steps."""
        for number in range(ROUNDS):
            self._predict()
            if FIRST_SELECTION <= number < SELECTIONS:
                self._select(moved=number >= FIRST_MOVED)
            equations, bends = self._equations(), len(self.curve.bends)
            if number < SELECTIONS:
                self._set_bend_sigma(equations.matrix)
            shared, own = equations.step()
            self.curve = replace(self.curve, bends=self.curve.bends + shared[:bends])
            self.shutter += shared[bends:]
            self.brightness += own
            self.converged = float(np.abs(shared).max()) < NEGLIGIBLE_STEP
            if self.converged and number >= FIRST_MOVED:
                break
        self._predict()
        self._select(moved=True)

    @property
    def exposures_s(self) -> Array:
        """Fitted exposures (J,) [s]."""
        return np.exp(self.shutter)

    def table(self, levels: Array) -> tuple[Array, Array]:
        """Light (K,) at levels (K,), 1 at level 1, and its standard errors (K,)."""
        curve = self.curve
        light, by_bend, count = curve.light(), curve.by_bends(), len(curve.bends)
        covariance = np.linalg.inv(self._equations().matrix)[:count, :count]
        change = (by_bend - np.outer(light / light[-1], by_bend[-1])) / light[-1]
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

    def scatter(self) -> float:
        """Typical sigma of the selected samples about the curve, as a share of the range [-]."""
        return float(np.median(self.noise[self.use])) if self.use.any() else 1.0

    def _initial_brightness(self) -> Array:
        light = np.interp(self.blocks.level, self.curve.levels, self.curve.light())
        rate = np.log(np.maximum(light, 1e-9)) - self.nominal[:, None]
        weight = self.blocks.sound * self.blocks.level + 1e-9
        return np.asarray(np.average(rate, axis=0, weights=weight))

    def _predict(self) -> None:
        light = np.exp(self.brightness + self.shutter[:, None])
        self.predicted = np.interp(light, self.curve.light(), self.curve.levels)

    def _select(self, *, moved: bool) -> None:
        """Select the samples and estimate their noise; from some step on without blocks that moved."""
        low, high = self._limits()
        leverage, sigma = self._leverage()
        # a sample's own noise must not decide whether it is used
        alone = self.predicted - leverage / (1 - leverage) * self.residual() * self.use
        known = leverage < MAX_LEVERAGE  # by the other samples too
        alone, sigma = np.where(known, alone, self.predicted), np.where(known, sigma, 0.0)
        inside = self.blocks.sound & (alone > low) & (alone + ALONE_SIGMAS * sigma < high)
        self.moved = np.asarray(self._outliers(inside).any(axis=0) & moved)
        self.use = inside & ~self.moved
        self.use &= self.use.sum(axis=0) >= 2
        self.noise = self._noise_by_level()

    def _outliers(self, inside: BoolArray) -> BoolArray:
        """Samples (J, N) away from the others of their photograph at their level: something moved there."""
        off = self.residual()
        for j, row in enumerate(inside):
            at = np.flatnonzero(row)[np.argsort(self.predicted[j, row])]
            for group in np.array_split(at, max(1, min(NOISE_GROUPS, at.size // MIN_IN_GROUP))):
                off[j, group] -= np.median(off[j, group]) if group.size else 0.0
        limit = np.maximum(MOVED_SIGMAS * self.noise, MOVED_LEVEL)
        return np.asarray(inside & (np.abs(off) > limit))

    def _leverage(self) -> tuple[Array, Array]:
        """Share (J, N) of a sample in its own prediction, and sigma of the prediction without it."""
        slope, light = self.curve.slope, self.curve.light()
        by_brightness = np.interp(self.predicted, self.curve.levels, light / slope)
        counted = np.where(self.use.any(axis=0), self.use, self.blocks.sound)
        weight = counted * (by_brightness / self.noise) ** 2
        total = weight.sum(axis=0)
        leverage = np.minimum(weight / np.maximum(total, 1e-12), 1 - 1e-3)
        return leverage, by_brightness / np.sqrt(np.maximum(total - weight, 1e-3))

    def _limits(self) -> tuple[float, float]:
        """Levels between which noise is not clipped nor, near black, distorted by the curve."""
        margins = []
        for sigmas, level in ((DARK_SIGMAS, self.predicted), (WHITE_SIGMAS, 1 - self.predicted)):
            near = self.noise[self.blocks.sound & (level < NEAR_END)]
            noise = self.blocks.edge * float(np.median(near)) if near.size else MAX_MARGIN
            margins.append(float(np.clip(sigmas * noise, MIN_MARGIN, MAX_MARGIN)))
        return margins[0], 1 - margins[1]

    def _noise_by_level(self) -> Array:
        """Robust sigma of the residuals (J, N), interpolated over the predicted level."""
        share = self._leverage()[0]
        free = self.use & (share < MAX_LEVERAGE)
        residual, level = (self.residual() / np.sqrt(1 - share))[free], self.predicted[free]
        if not residual.size:
            return self.noise
        middles, sigmas = [0.5], [robust_sigma(residual, 0.0)]
        for group in np.array_split(np.argsort(level), NOISE_GROUPS):
            if group.size >= MIN_IN_GROUP:
                middles.append(float(level[group].mean()))
                sigmas.append(robust_sigma(residual[group], 0.0))
        order = np.argsort(middles)
        table = np.maximum(np.array(sigmas)[order], MIN_NOISE)
        return np.interp(self.predicted, np.array(middles)[order], table)

    def _equations(self) -> _ResponseEquations:
        curve = self.curve
        levels, slope, light = curve.levels, curve.slope, curve.light()
        by_bend = make_interp_spline(levels, curve.by_bends(), k=1)
        photos, blocks = self.use.shape
        bends = len(curve.bends)
        total = bends + photos
        matrix, right = np.zeros((total, total)), np.zeros(total)
        cross, own, own_right = np.zeros((blocks, total)), np.zeros(blocks), np.zeros(blocks)
        for j, level in enumerate(self.predicted):
            residual, steepness = self.blocks.level[j] - level, np.interp(level, levels, slope)
            # the shutter time acts as the brightness does
            by_brightness = np.interp(level, levels, light) / steepness
            rows = by_bend(level) / -steepness[:, None]
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

    def _set_bend_sigma(self, matrix: Array) -> None:
        """The prior's widths under which the bends found are likely, wide where one stands out.

        The prior is Student's t, as normal distributions whose widths have a common scale.
        """
        count = len(self.curve.bends)
        second = second_differences(count)
        spread = second @ np.linalg.inv(matrix)[:count, :count] @ second.T
        square = (second @ (self.curve.bends - self.start)) ** 2 + np.diagonal(spread)
        square /= self.widths**2
        wide = (FREEDOM * self.scale**2 + square) / (FREEDOM + 1)
        self.scale = float(np.clip(self.scale * np.sqrt(np.mean(square / wide)), *BEND_SIGMAS))
        self.bend_sigma = np.sqrt(wide) * self.widths

    def _add_priors(self, matrix: Array, right: Array) -> None:
        bends, count = self.curve.bends - self.start, len(self.curve.bends)
        second = second_differences(count) / self.bend_sigma[:, None]
        matrix[:count, :count] += second.T @ second
        matrix[:count, :count] += np.eye(count) / COEFFICIENT_SIGMA**2
        right[:count] -= second.T @ (second @ bends) + bends / COEFFICIENT_SIGMA**2
        matrix[count:, count:] += np.eye(len(self.nominal)) / SHUTTER_SIGMA**2
        right[count:] -= (self.shutter - self.nominal) / SHUTTER_SIGMA**2
