"""The curve behind photographs of one scene at several exposures: the fit, and what it refuses.

Unknown are the curve, the shutter times within their tolerance, and the brightness of every block of
pixels. Levels are predicted, so that residuals are where the noise is; fits of the light itself, as by
Debevec & Malik 1997 (doi:10.1145/258734.258884) and Mitsunaga & Nayar 1999
(doi:10.1109/CVPR.1999.786966), are bent by noise.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from procam.errors import DidNotConverge, NotEnoughData, OutOfModelRange

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SHUTTER_SIGMA = 0.02  # relative: headers say 1/60 and 1/125, shutters do 1/64 and 1/128
LARGEST_SHUTTER_SIGMAS = 5.0
PIECES = 12  # of the spline of the logarithm of the slope
GRID = 1025
BEND_SIGMA = 0.25  # of its second differences: it carries the curve on where no sample tells
FAR_BEND = 100.0  # nothing for a curve; without samples the equations have an answer all the same
BOTH_ENDS = 0.8  # share of the knots' crowding that white gets too: there tone curves roll off
DARK_SIGMAS, WHITE_SIGMAS = 6.0, 2.5  # nearer to an end, noise is bent or clipped
NARROWEST_END, WIDEST_END, NEAR_END = 0.005, 0.05, 0.06  # of the range
ROUNDS, LONGEST_STEP, SMALL_STEP = 50, 0.5, 1e-4
FREE_ROUNDS = 20  # after them weights and samples stay, or they may come and go for ever
HUBER = 2.5
CHECKED_BINS, FEWEST_IN_BIN, FEWEST_FOR_NOISE = 20, 8, 50
WORST_MISFIT, MISFIT_SIGMAS = 0.01, 5.0  # of a photograph at some level, of the range
MOVED_SIGMAS, MOVED_LEVEL, MOST_MOVED = 6.0, 0.015, 0.1


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means of N squares of `edge` pixels in J photographs.

    `level` (J, N) 0..1, `spread` (J, N) of their pixels, `sound` (J, N) where none of them is clipped.
    """

    edge: int
    level: Array
    spread: Array
    sound: Mask

    def take(self, chosen: NDArray[np.intp]) -> "Blocks":
        """Some of them."""
        level, spread, sound = self.level[:, chosen], self.spread[:, chosen], self.sound[:, chosen]
        return Blocks(self.edge, level, spread, sound)


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

    def light(self) -> tuple[Array, Array]:
        """Light (G,) and its derivatives (G, P) by the bends."""
        steps = np.diff(self.levels)[:, None] / 2
        parts = self.slope[:, None] * np.column_stack([np.ones(len(self.levels)), self.basis])
        summed = np.cumsum((parts[1:] + parts[:-1]) * steps, axis=0)
        summed = np.vstack([np.zeros(summed.shape[1]), summed])
        return summed[:, 0], summed[:, 1:]


def _start() -> _Curve:
    """A gamma of 2; knots are dense near black and white, where curves bend most."""
    even = np.linspace(0, 1, GRID)
    levels = (1 - BOTH_ENDS) * even**2 + BOTH_ENDS * np.sin(np.pi / 2 * even) ** 2
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, PIECES + 1), np.ones(3)])
    basis = BSpline.design_matrix(even, knots, 3).toarray()
    bends = np.linalg.lstsq(basis, np.log(levels + 0.01), rcond=None)[0]
    # the last is fixed: a common factor of light and brightness is free
    return _Curve(levels, basis[:, :-1], (bends - bends[-1])[:-1])


@dataclass(frozen=True, slots=True)
class _Normal:
    """Normal equations (P, P), (P,) without the brightnesses, and what (N, P), (N,), (N,) gives those."""

    matrix: Array
    right: Array
    shared: Array
    own: Array
    pulled: Array

    def brightness_step(self, step: Array) -> Array:
        """What a step (P,) of the others leaves to the brightnesses (N,)."""
        return np.asarray((self.pulled - self.shared @ step) / self.own)


def _interpolated(at: Array, grid: Array, rows: Array) -> Array:
    """Rows (G, P) that belong to a rising grid (G,), at other places (N,)."""
    low = np.clip(np.searchsorted(grid, at) - 1, 0, len(grid) - 2)
    share = ((at - grid[low]) / (grid[low + 1] - grid[low]))[:, None]
    return np.asarray(rows[low] * (1 - share) + rows[low + 1] * share)


class CameraResponseFit:
    """Gauss-Newton on bends and shutter times, the blocks' brightnesses eliminated."""

    def __init__(self, blocks: Blocks, seconds: Array) -> None:
        self.blocks = blocks
        self.told = np.log(seconds)
        self.shutter = self.told.copy()
        self.curve = _start()
        self.brightness = self._first_brightness()
        self.predicted = blocks.level
        self.use = blocks.sound
        self.noise = np.full_like(blocks.level, 0.01)

    def solve(self) -> None:
        """Iterate to the end, and check that one curve fits all."""
        done = False
        for number in range(ROUNDS):
            self._predict()
            if number < FREE_ROUNDS:
                self._select()
            done = self._step() < SMALL_STEP
            if done:
                break
        self._predict()
        self._select()
        self._check()
        if not done:
            raise DidNotConverge(
                f"brackets: got no end of the fit within {ROUNDS} steps, expected one; is it one still "
                "scene at fixed settings? add exposures"
            )

    def _step(self) -> float:
        """One step of Gauss-Newton; its size [-]."""
        normal, bends = self._normal(), len(self.curve.bends)
        step = np.asarray(np.linalg.solve(normal.matrix, normal.right), float)
        size = float(np.abs(step).max())
        shorter = min(1.0, LONGEST_STEP / max(size, 1e-12))
        lights = shorter * normal.brightness_step(step)
        self.curve = replace(self.curve, bends=self.curve.bends + shorter * step[:bends])
        self.shutter += shorter * step[bends:]
        self.brightness += np.clip(lights, -LONGEST_STEP, LONGEST_STEP)
        return size

    def _check(self) -> None:
        self._check_coverage()
        self._check_shutter()
        residual = np.where(self.use, self._residual(), np.nan)
        self._check_still(residual)
        for number, left in enumerate(residual):
            self._check_profile(number, left)

    def table(self, levels: Array) -> tuple[Array, Array]:
        """Light (K,) of levels (K,), 1 at level 1, and its standard errors (K,)."""
        light, by_bend = self.curve.light()
        count, grid = len(self.curve.bends), self.curve.levels
        covariance = np.linalg.inv(self._normal().matrix)[:count, :count]
        change = (by_bend - np.outer(light, by_bend[-1]) / light[-1]) / light[-1]
        variance = np.einsum("gp,pq,gq->g", change, covariance, change)
        sigma = np.sqrt(np.maximum(variance, 0))
        return np.interp(levels, grid, light / light[-1]), np.interp(levels, grid, sigma)

    def residual_rms(self) -> float:
        """Of the levels about the fit, a share of their range [-]."""
        return float(np.sqrt(np.mean(self._residual()[self.use] ** 2)))

    def _first_brightness(self) -> Array:
        level, sound = self.blocks.level, self.blocks.sound
        light = np.interp(level, self.curve.levels, self.curve.light()[0])
        rate = np.log(np.maximum(light, 1e-9)) - self.shutter[:, None]
        return np.asarray(np.average(rate, axis=0, weights=sound * level + 1e-9))

    def _predict(self) -> None:
        light = self.curve.light()[0]
        expected = np.exp(self.brightness + self.shutter[:, None])
        self.predicted = np.interp(expected, light, self.curve.levels)

    def _select(self) -> None:
        """Samples that count (J, N), and their noise."""
        low, high = self._ends()
        self.use = self.blocks.sound & (self.predicted > low) & (self.predicted < high)
        self.use &= self.use.sum(axis=0) >= 2
        self.noise = self._noise_by_level()

    def _ends(self) -> tuple[float, float]:
        """Levels between which a pixel's noise is neither clipped nor, near black, bent by the curve."""
        ends = []
        for sigmas, level in ((DARK_SIGMAS, self.predicted), (WHITE_SIGMAS, 1 - self.predicted)):
            near = self.noise[self.use & (level < NEAR_END)]
            noise = self.blocks.edge * float(np.median(near)) if near.size else WIDEST_END
            ends.append(float(np.clip(sigmas * noise, NARROWEST_END, WIDEST_END)))
        return ends[0], 1 - ends[1]

    def _noise_by_level(self) -> Array:
        """Robust spread of the residuals (J, N), by predicted level."""
        left, at = self._residual()[self.use], self.predicted[self.use]
        middles, spreads = [0.5], [1.4826 * float(np.median(np.abs(left))) if left.size else 1.0]
        for part in np.array_split(np.argsort(at), CHECKED_BINS):
            if part.size >= FEWEST_FOR_NOISE:
                middles.append(float(at[part].mean()))
                spreads.append(1.4826 * float(np.median(np.abs(left[part]))))
        order = np.argsort(middles)
        table = np.maximum(np.array(spreads)[order], 1e-6)
        return np.interp(self.predicted, np.array(middles)[order], table)

    def _residual(self) -> Array:
        return np.asarray(self.blocks.level - self.predicted)

    def _normal(self) -> "_Normal":
        """Normal equations of bends and shutter times, with their priors."""
        light, by_bend = self.curve.light()
        levels, slope = self.curve.levels, self.curve.slope
        bends, photos = by_bend.shape[1], len(self.told)
        total = bends + photos
        matrix, right = np.zeros((total, total)), np.zeros(total)
        shared, own, pulled = (np.zeros((self.brightness.size, *n)) for n in ((total,), (), ()))
        for j in range(photos):
            at, left = self.predicted[j], self.blocks.level[j] - self.predicted[j]
            steep = np.interp(at, levels, slope)
            by_bright = np.interp(at, levels, light) / steep
            rows = _interpolated(at, levels, -by_bend)
            rows /= steep[:, None]
            weight = self.use[j] / self.noise[j] ** 2
            weight /= np.maximum(np.abs(left) / (HUBER * self.noise[j]), 1)
            pull = weight * by_bright  # the shutter time acts as the brightness does
            matrix[:bends, :bends] += rows.T @ (weight[:, None] * rows)
            matrix[:bends, bends + j] = matrix[bends + j, :bends] = rows.T @ pull
            matrix[bends + j, bends + j] = pull @ by_bright
            right[:bends] += rows.T @ (weight * left)
            right[bends + j] = pull @ left
            shared[:, :bends] += pull[:, None] * rows
            shared[:, bends + j] = pull * by_bright
            own += pull * by_bright
            pulled += pull * left
        own = np.maximum(own, 1e-12)
        matrix -= (shared / own[:, None]).T @ shared
        right -= shared.T @ (pulled / own)
        return _Normal(*self._with_priors(matrix, right), shared, own, pulled)

    def _with_priors(self, matrix: Array, right: Array) -> tuple[Array, Array]:
        count = len(self.curve.bends)
        second = np.diff(np.eye(count + 1), 2, axis=0)[:, :-1] / BEND_SIGMA
        matrix[:count, :count] += second.T @ second
        right[:count] -= second.T @ (second @ self.curve.bends) + self.curve.bends / FAR_BEND**2
        matrix[:count, :count] += np.eye(count) / FAR_BEND**2
        matrix[count:, count:] += np.eye(len(self.told)) / SHUTTER_SIGMA**2
        right[count:] -= (self.shutter - self.told) / SHUTTER_SIGMA**2
        return matrix, right

    def _check_coverage(self) -> None:
        seen = np.histogram(self.predicted[self.use], CHECKED_BINS, (0, 1))[0]
        thin = np.flatnonzero(seen[1:-1] < FEWEST_IN_BIN) + 1
        if thin.size:
            low, high = thin[0] / CHECKED_BINS, (thin[0] + 1) / CHECKED_BINS
            raise NotEnoughData(
                f"brackets: got {seen[thin[0]]} places at levels {low:.0%} to {high:.0%} of the range, "
                f"expected {FEWEST_IN_BIN} or more; add exposures, or a scene with all shades from deep "
                "shadow to white"
            )

    def _check_shutter(self) -> None:
        off = np.abs(self.shutter - self.told) / SHUTTER_SIGMA
        worst = int(np.argmax(off))
        if off[worst] > LARGEST_SHUTTER_SIGMAS:
            raise OutOfModelRange(
                f"brackets: {self._name(worst)}: got the light of {np.exp(self.shutter[worst]):.4g} s, "
                f"expected its own within {LARGEST_SHUTTER_SIGMAS * SHUTTER_SIGMA:.0%}; is the exposure "
                "right, ISO and aperture fixed, and the scene's light steady?"
            )

    def _check_still(self, residual: Array) -> None:
        limit = np.maximum(MOVED_SIGMAS * self.noise, MOVED_LEVEL)
        moved = float((np.abs(residual) > limit)[:, self.use.any(axis=0)].any(axis=0).mean())
        if moved > MOST_MOVED:
            raise OutOfModelRange(
                f"brackets: got {moved:.0%} of the places that no curve fits, expected {MOST_MOVED:.0%} "
                "at most; use a tripod and a still scene, fixed focus, and one picture profile"
            )

    def _check_profile(self, number: int, residual: Array) -> None:
        """Refuse a photograph whose levels differ from the curve of all, at any level."""
        use = self.use[number]
        bins = np.minimum(CHECKED_BINS * self.predicted[number, use], CHECKED_BINS - 1).astype(int)
        counts = np.bincount(bins, minlength=CHECKED_BINS)
        means = np.bincount(bins, residual[use], CHECKED_BINS) / np.maximum(counts, 1)
        chance = MISFIT_SIGMAS * float(np.median(self.noise)) / np.sqrt(np.maximum(counts, 1))
        told = (counts >= FEWEST_IN_BIN) & (np.abs(means) > chance)
        misfit = np.abs(means[told]).max(initial=0.0)
        if misfit > WORST_MISFIT:
            raise OutOfModelRange(
                f"brackets: {self._name(number)}: got levels {misfit:.1%} of the range off what the "
                f"others tell, expected {WORST_MISFIT:.0%} at most; one picture profile, white balance "
                "and contrast for all, and nothing that moves"
            )

    def _name(self, number: int) -> str:
        return f"photograph {number + 1} ({np.exp(self.told[number]):g} s)"
