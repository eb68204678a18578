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
FINE = 0.01  # the same of one that needs no second look at the next picture
LEAST_RATE = 0.005  # that a slope is ever trusted with
ROUNDING = 2e-6  # of the value: below it single precision of a small picture may stop all progress
PATIENCE = 8  # steps for what is below that


@dataclass(slots=True)
class Root:
    """Where a residual (C, K) vanishes, and the slope (C, K, K) there, kept for the next picture.

    `rate` is what a step with that slope last left of the residual; 1 while that is not known. A
    slope that is not `tuned` was not taken near a root.
    """

    value: Array
    slope: Array
    rate: float = 1.0
    tuned: bool = False

    def follow(
        self,
        residual: Callable[[Array], Array],
        slope: Callable[[Array], Array],
        tolerance: float,
    ) -> None:
        """Move to the root of `residual`.

        Newton's method per colour, with the slope at hand as long as it serves. A colour rests where all
        of its residual is below `tolerance` of its largest value, or will be after a step as good as the
        last one, or near rounding no step helps.
        """
        found, stuck = residual(self.value), np.zeros(len(self.value), bool)
        for number in range(MAX_STEPS):
            left, size = np.abs(found).max(axis=1), np.abs(self.value).max(axis=1)
            done = (left <= tolerance * size) | (left == 0)
            done |= (stuck | (number >= PATIENCE)) & (left <= ROUNDING * size)
            if done.all():
                return
            step = np.asarray(np.linalg.solve(-self.slope, found[..., None])[..., 0])
            step[done] = 0
            if (
                (left * self.rate <= tolerance * size) | done
            ).all():  # what it leaves can be foretold
                self.value = self.value + step
                return
            after = residual(self.value + step)
            ratio = np.where(done, 0, _norm(after) / np.maximum(_norm(found), 1e-300))
            if (ratio > QUICK).any():
                self.slope, self.tuned = slope(self.value), False
                step = np.asarray(np.linalg.solve(-self.slope, found[..., None])[..., 0])
                step[done] = 0
                after, ratio = self._helpful(residual, found, step, done)
            stuck, self.rate = ratio > 1 / 2, max(float(ratio.max()), LEAST_RATE)
            self.value, found = self.value + step, after
            if self.rate > FINE and not self.tuned:
                self.slope, self.tuned = slope(self.value), True
        raise DidNotConverge(
            f"compensation: the light still moves after {MAX_STEPS} steps (by "
            f"{np.abs(found).max():.3g}); check scatter_per_flux for negative or non-finite values"
        )

    def _helpful(
        self,
        residual: Callable[[Array], Array],
        found: Array,
        step: Array,
        done: NDArray[np.bool_],
    ) -> tuple[Array, Array]:
        """Residual after a step, and its share of the one before; halves `step` while it does not help."""
        after = residual(self.value + step)
        for _ in range(HALVINGS):
            worse = ~done & (_norm(after) > _norm(found))
            if not worse.any():
                break
            step[worse] /= 2
            after = residual(self.value + step)
        step[~done & (_norm(after) > _norm(found))] = 0
        after = np.where((step == 0).all(axis=1)[:, None], found, after)
        return after, np.where(done, 0, _norm(after) / np.maximum(_norm(found), 1e-300))


def _norm(values: Array) -> Array:
    return np.asarray(np.linalg.norm(values, axis=1))
