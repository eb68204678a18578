"""Roots of nearly linear equations whose every evaluation reads a whole picture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import DidNotConverge

Array = NDArray[np.float64]
MAX_STEPS = 40
HALVINGS = 6
ROUNDING = 1e-7  # of the value: below it single precision of a small picture may stop all progress


@dataclass(slots=True)
class Root:
    """Where a residual (C, K) vanishes, and its slopes (C, K, K), kept for the next picture."""

    value: Array
    slope: Array

    def follow(self, residual: Callable[[Array], Array], tolerance: float) -> Array:
        """Move to the root of `residual`; gives back what is left of it.

        Broyden's method per colour: each evaluation also mends the slope along the step taken. A colour
        rests where all of it is below `tolerance` of its largest value, or no step makes it smaller.
        """
        found = residual(self.value)
        stuck = np.zeros(len(found), bool)
        for _ in range(MAX_STEPS):
            left, size = np.abs(found).max(axis=1), np.abs(self.value).max(axis=1)
            done = (left <= tolerance * size) | (stuck & (left <= ROUNDING * size)) | (left == 0)
            if done.all():
                return found
            step = np.asarray(np.linalg.solve(-self.slope, found[..., None])[..., 0])
            step[done] = 0
            after = residual(self.value + step)
            for _ in range(HALVINGS):
                worse = ~done & (_norm(after) > _norm(found))
                if not worse.any() or (worse <= (left <= ROUNDING * size)).all():
                    break
                step[worse] /= 2
                after = residual(self.value + step)
            stuck = ~done & (_norm(after) > _norm(found) / 2)
            self._mend(step, np.asarray(after - found), ~done & ~stuck)
            self.value, found = self.value + step, after
        raise DidNotConverge(
            f"compensation: the light still moves after {MAX_STEPS} steps (by "
            f"{np.abs(found).max():.3g}); check scatter_per_flux for negative or non-finite values"
        )

    def _mend(self, step: Array, change: Array, where: NDArray[np.bool_]) -> None:
        wrong = change - np.einsum("cij,cj->ci", self.slope, step)
        square = np.where(where, np.einsum("ci,ci->c", step, step), np.inf)
        self.slope = self.slope + np.einsum("ci,cj->cij", wrong, step) / square[:, None, None]


def _norm(values: Array) -> Array:
    return np.asarray(np.linalg.norm(values, axis=1))
