"""Problem (P): direct light within limits whose total is the target wherever that can be."""

import numpy as np
from numpy.typing import NDArray

from procam.errors import DidNotConverge

Array = NDArray[np.float64]
MAX_STEPS = 60


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
