"""Roots of piecewise linear equations with few unknowns, each evaluation of which reads a whole picture.

Newton's method with a slope that is kept from step to step and from picture to picture. Broyden's update
corrects it after each step; it is computed anew only where it no longer reduces the residual.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray
from procam.errors import DidNotConverge

MAX_STEPS = 40
HALVINGS = 8
QUICK = 0.05  # largest ratio of residuals after and before a step for which the slope is kept
LEAST_STEP = 1e-4  # of the value: smaller steps do not update the slope, they are mostly rounding
COLLAPSE = 0.1  # of its determinant: updates that reduce it below are refused
BLACK = 1e-12  # residual of a black picture [rel sr]
ROUNDING = 2e-6  # of the value: single precision of a small picture may stop progress below it
PATIENCE = 8  # steps after which a residual below that is accepted


@dataclass(slots=True)
class Root:
    """Where a residual (C, K) vanishes, and the slope (C, K, K) there, kept for the next picture.

    `shrink` is the ratio of residuals after and before the last step.
    """

    value: Array
    slope: Array
    shrink: float = QUICK

    def follow(
        self,
        residual: Callable[[Array, bool], Array],
        slope: Callable[[Array], Array],
        tolerance: float,
    ) -> None:
        """Move to the root of `residual`.

        Newton's method per colour, with the present slope as long as it converges. A colour is done
        when its residual is below `tolerance` of its largest value, or when no step reduces it near
        rounding. The second argument of `residual` is whether the evaluation is likely the last one.
        """
        found, stuck = residual(self.value, False), np.zeros(len(self.value), bool)
        for number in range(MAX_STEPS):
            left, size = np.abs(found).max(axis=1), np.abs(self.value).max(axis=1)
            done = _within(tolerance, found, self.value)
            done |= (stuck | (number >= PATIENCE)) & (left <= ROUNDING * size)
            if done.all():
                return
            step = self._step(found, done)
            likely = bool((self.shrink * left <= tolerance * size)[~done].all())
            after = residual(self.value + step, likely)
            reached = _within(tolerance, after, self.value + step)
            if (_norm(after) > QUICK * _norm(found))[~(done | reached)].any():
                self.slope = slope(self.value)
                step = self._step(found, done)
                after = self._reduced(residual, found, step)
            self._update(
                step, after - found, ~done & (np.abs(step).max(axis=1) > LEAST_STEP * size)
            )
            self.shrink = float((_norm(after) / np.maximum(_norm(found), 1e-300))[~done].max())
            stuck = _norm(after) > _norm(found) / 2
            self.value, found = self.value + step, after
        raise DidNotConverge(
            f"compensation: not solved after {MAX_STEPS} steps (residual {np.abs(found).max():.3g}); "
            "check scatter_per_flux for negative or non-finite values"
        )

    def _step(self, found: Array, done: BoolArray) -> Array:
        step = np.linalg.solve(-self.slope, found[..., None])[..., 0]
        return np.where(done[:, None], 0, step)

    def _update(self, step: Array, change: Array, where: BoolArray) -> None:
        """Correct the slope by what a step changed (Broyden 1965, eq. 4.5), unless it becomes singular."""
        missed = change - (self.slope @ step[..., None])[..., 0]
        along = step / np.maximum((step**2).sum(axis=1), 1e-300)[:, None]
        updated = self.slope + missed[..., None] * along[:, None]
        size, before = (np.abs(np.linalg.det(slope)) for slope in (updated, self.slope))
        where = where & (size > COLLAPSE * before)
        self.slope = np.where(where[:, None, None], updated, self.slope)

    def _reduced(
        self, residual: Callable[[Array, bool], Array], found: Array, step: Array
    ) -> Array:
        """Residual after a step, which is halved while it does not reduce that of a colour, at last to 0."""
        for _ in range(HALVINGS):
            after = residual(self.value + step, False)
            worse = _norm(after) > _norm(found)
            if not worse.any():
                return after
            step[worse] /= 2
        step[worse] = 0
        return np.where(worse[:, None], found, after)


def _within(tolerance: float, residual: Array, value: Array) -> BoolArray:
    """Colours whose residual is below `tolerance` of their largest value, or black."""
    most = np.maximum(tolerance * np.abs(value).max(axis=1), BLACK)
    return np.asarray(np.abs(residual).max(axis=1) <= most)


def _norm(values: Array) -> Array:
    return np.asarray(np.linalg.norm(values, axis=1))
