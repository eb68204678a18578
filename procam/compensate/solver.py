"""Roots of piecewise linear equations whose every evaluation reads a whole picture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import DidNotConverge

Array = NDArray[np.float64]
MAX_STEPS = 40
HALVINGS = 8
QUICK = 0.05  # what a step with a slope that still serves leaves of the residual, at most
TELLING = 1e-4  # of the value: of smaller steps the slope learns rounding
COLLAPSE = 0.1  # of its determinant: what is less a slope does not learn
NOTHING = 1e-12  # of white over a steradian: black
ROUNDING = 2e-6  # of the value: below it single precision of a small picture may stop all progress
PATIENCE = 8  # steps for what is below that


@dataclass(slots=True)
class Root:
    """Where a residual (C, K) vanishes, and the slope (C, K, K) there, kept for the next picture.

    `shrink` is what the last step left of the residual.
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

        Newton's method per colour, with the slope at hand as long as it serves. A colour rests where all
        of its residual, looked up there, is below `tolerance` of its largest value, or near rounding no
        step helps. `residual` is also told whether the look will likely be the last.
        """
        found, stuck = residual(self.value, False), np.zeros(len(self.value), bool)
        for number in range(MAX_STEPS):
            left, size = np.abs(found).max(axis=1), np.abs(self.value).max(axis=1)
            done = left <= np.maximum(tolerance * size, NOTHING)
            done |= (stuck | (number >= PATIENCE)) & (left <= ROUNDING * size)
            if done.all():
                return
            step = self._step(found, done)
            likely = bool((self.shrink * left <= tolerance * size)[~done].all())
            after = residual(self.value + step, likely)
            if (_norm(after) > QUICK * _norm(found))[~done].any():
                self.slope = slope(self.value)
                step = self._step(found, done)
                after = self._helpful(residual, found, step)
            self._learn(step, after - found, ~done & (np.abs(step).max(axis=1) > TELLING * size))
            self.shrink = float((_norm(after) / np.maximum(_norm(found), 1e-300))[~done].max())
            stuck = _norm(after) > _norm(found) / 2
            self.value, found = self.value + step, after
        raise DidNotConverge(
            f"compensation: the light still moves after {MAX_STEPS} steps (by "
            f"{np.abs(found).max():.3g}); check scatter_per_flux for negative or non-finite values"
        )

    def _step(self, found: Array, done: NDArray[np.bool_]) -> Array:
        step = np.linalg.solve(-self.slope, found[..., None])[..., 0]
        return np.where(done[:, None], 0, step)

    def _learn(self, step: Array, change: Array, where: NDArray[np.bool_]) -> None:
        """Slopes that account for what a step changed (Broyden 1965, eq. 4.5), unless they collapse."""
        missed = change - (self.slope @ step[..., None])[..., 0]
        along = step / np.maximum((step**2).sum(axis=1), 1e-300)[:, None]
        learnt = self.slope + missed[..., None] * along[:, None]
        size, before = (np.abs(np.linalg.det(slope)) for slope in (learnt, self.slope))
        where = where & (size > COLLAPSE * before)
        self.slope = np.where(where[:, None, None], learnt, self.slope)

    def _helpful(
        self, residual: Callable[[Array, bool], Array], found: Array, step: Array
    ) -> Array:
        """Residual after a step; `step` is halved while it does not help a colour, at last to nothing."""
        for _ in range(HALVINGS):
            after = residual(self.value + step, False)
            worse = _norm(after) > _norm(found)
            if not worse.any():
                return after
            step[worse] /= 2
        step[worse] = 0
        return np.where(worse[:, None], found, after)


def _norm(values: Array) -> Array:
    return np.asarray(np.linalg.norm(values, axis=1))
