"""Exact compensation: direct light within limits whose total is the target wherever no limit holds.

With N = I + U V^T the scattered light depends on the picture through the moments V^T b0 alone, so the
problem over all patches reduces to K unknowns (docs/theory/compensation.md, C2), solved by Newton's
method on a piecewise linear function.
"""

import numpy as np

from procam.arrays import Array, BoolArray
from procam.errors import DidNotConverge

MAX_STEPS = 60
HALVINGS = 12
TINY = 1e-12


def solve_moments(target: Array, spread: Array, collect: Array, lo: Array, hi: Array) -> Array:
    """Moments M (K,) that solve V^T clip(t - U M, lo, hi) = M, for one channel.

    This is (C2) with `spread` U (N, K) and `collect` V (N, K); K = 1 is the flux of a bare sphere. The
    Jacobian is I + V_F^T U_F over the patches F that are not clipped; a step is halved until it reduces
    the residual.

    Raises
    ------
    DidNotConverge
        If the moments still change after `MAX_STEPS` steps.
    """

    def residual(at: Array) -> tuple[Array, BoolArray]:
        wanted = target - spread @ at
        return collect.T @ np.clip(wanted, lo, hi) - at, (wanted > lo) & (wanted < hi)

    value = collect.T @ np.clip(target, lo, hi)
    left, free = residual(value)
    scale = max(float(np.abs(value).max()), 1e-300)
    for _ in range(MAX_STEPS):
        slope = np.eye(len(value)) + collect[free].T @ spread[free]
        step = np.linalg.solve(slope, left)
        for _ in range(HALVINGS):
            after, free = residual(value + step)
            if np.linalg.norm(after) < np.linalg.norm(left):
                break
            step /= 2
        else:
            after, free = residual(value + step)
        value, left = value + step, after
        if np.abs(step).max() <= TINY * scale:
            return np.asarray(value)
    raise DidNotConverge(
        f"exact compensation: the moments still change after {MAX_STEPS} steps (by "
        f"{np.abs(step).max():.3g}); check scatter_per_flux for negative or non-finite values"
    )
