"""Scattered light between patches in the closed loop, and that of few moments, as on a dome."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from procam.arrays import Array, BoolArray
from procam.maths.light.box_solver import solve_moments


def remove_scatter(change: Array, free: BoolArray, spread: Array, collect: Array) -> Array:
    """Change of direct light (n,) on the `free` patches (n,) that changes their total by `change` (n,).

    dx_F = r_F - U_F (I + V_F^T U_F)^-1 V_F^T r_F (docs/theory/closed-loop.md, L2) for scatter U V^T, `spread`
    and `collect` (n, K). The other patches are held and only reflect. (L3) is the same on a sphere.
    """
    system = np.eye(collect.shape[1]) + collect[free].T @ spread[free]
    moments = np.linalg.solve(system, collect[free].T @ change[free])
    return np.where(free, change - spread @ moments, 0.0)


class Scatter(Protocol):
    """Light that n patches scatter at each other in C channels, as calibrated; `factor` (C,) is c of (L1)."""

    def of(self, direct: Array) -> Array:
        """Scattered light (n, C) [rel] of direct light (n, C)."""

    def removed(self, change: Array, free: BoolArray, factor: Array) -> Array:
        """Change of direct light (n, C) on `free` patches (n, C) that changes their total by `change`."""

    def limited(self, change: Array, down: Array, up: Array, factor: Array) -> Array:
        """Change of direct light (n, C) within -`down` and `up` (n, C) nearest to that of the total."""


@dataclass(frozen=True, slots=True)
class PatchScatter:
    """Scatter b+ = U V^T b0 of C channels on n patches: U `spread` (C, n, K), V `collect` (n, K)."""

    spread: Array
    collect: Array

    def of(self, direct: Array) -> Array:
        """See `Scatter`."""
        return np.einsum("cnk,kc->nc", self.spread, self.collect.T @ direct)

    def removed(self, change: Array, free: BoolArray, factor: Array) -> Array:
        """See `Scatter` and `remove_scatter`."""
        found = [
            remove_scatter(change[:, c], free[:, c], f * self.spread[c], self.collect)
            for c, f in enumerate(factor)
        ]
        return np.stack(found, axis=1)

    def limited(self, change: Array, down: Array, up: Array, factor: Array) -> Array:
        """See `Scatter`; which patches are held follows by Newton's method."""
        found = np.empty_like(change)
        for c, f in enumerate(factor):
            spread, limits = f * self.spread[c], (-down[:, c], up[:, c])
            moments = solve_moments(change[:, c], spread, self.collect, *limits)
            found[:, c] = np.clip(change[:, c] - spread @ moments, *limits)
        return found
