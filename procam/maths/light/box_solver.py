"""Problem (P): direct light within limits whose total is the target wherever that can be."""

import numpy as np
from numpy.typing import NDArray

from procam.errors import DidNotConverge

Array = NDArray[np.float64]
MAX_STEPS = 60
HALVINGS = 12
TINY = 1e-12


def solve_flux(
    target: Array, scatter_per_flux: Array, solid_angle_sr: Array, lo: Array, hi: Array
) -> float:
    """Direct flux [rel sr] at which clip(t - u flux, lo, hi) has that very flux (science.md s.5 P).

    One channel: all arrays (N,). h(F) = sum a clip(t - u F, lo, hi) - F falls strictly and is
    piecewise linear, so Newton's step from any point lands on the root of the current piece; a
    bracket guards it. The root is unique and every patch that is not clipped is exact.
    """
    low, high = float(solid_angle_sr @ lo), float(solid_angle_sr @ hi)
    value = float(np.clip(solid_angle_sr @ target, low, high))
    for _ in range(MAX_STEPS):
        wanted = target - scatter_per_flux * value
        excess = float(solid_angle_sr @ np.clip(wanted, lo, hi)) - value
        if excess > 0:
            low = value
        else:
            high = value
        free = (wanted > lo) & (wanted < hi)
        slope = 1.0 + float(solid_angle_sr[free] @ scatter_per_flux[free])
        following = value + excess / slope
        if not low <= following <= high:
            following = (low + high) / 2
        if abs(following - value) <= 1e-12 * max(high, 1e-300) or low == high:
            return following
        value = following
    raise DidNotConverge(
        f"exact compensation: the flux still moves after {MAX_STEPS} steps (between {low:.6g} and "
        f"{high:.6g}); check scatter_per_flux for negative or non-finite values"
    )


def solve_moments(target: Array, spread: Array, collect: Array, lo: Array, hi: Array) -> Array:
    """Moments M (K,) at which clip(t - U M, lo, hi) has those very moments V^T b0.

    The same problem where bounced light is U V^T b0, `spread` U (N, K), `collect` V (N, K); K = 1 is
    `solve_flux`. Newton's step solves the piece at hand, I + V_F^T U_F over the free patches; it is halved
    while it does not help.
    """

    def excess(at: Array) -> tuple[Array, NDArray[np.bool_]]:
        wanted = target - spread @ at
        return collect.T @ np.clip(wanted, lo, hi) - at, (wanted > lo) & (wanted < hi)

    value = collect.T @ np.clip(target, lo, hi)
    left, free = excess(value)
    scale = max(float(np.abs(value).max()), 1e-300)
    for _ in range(MAX_STEPS):
        slope = np.eye(len(value)) + collect[free].T @ spread[free]
        step = np.linalg.solve(slope, left)
        for _ in range(HALVINGS):
            after, free = excess(value + step)
            if np.linalg.norm(after) < np.linalg.norm(left):
                break
            step /= 2
        else:
            after, free = excess(value + step)
        value, left = value + step, after
        if np.abs(step).max() <= TINY * scale:
            return np.asarray(value)
    raise DidNotConverge(
        f"exact compensation: the light still moves after {MAX_STEPS} steps (by "
        f"{np.abs(step).max():.3g}); check scatter_per_flux for negative or non-finite values"
    )
