"""Root of the exact compensation (P) for one channel of a dome master."""

import numpy as np

from benchmarks.measure import Report, at_least, interleaved
from procam.maths.geometry.sphere import master_solid_angles
from procam.maths.light.box_solver import solve_moments


def bench() -> Report:
    """A 2048 px dome master, against bisection to the same tolerance."""
    rng = np.random.default_rng(1)
    solid = master_solid_angles(2048)
    solid = solid[solid > 0]
    target, u = rng.uniform(0, 1, solid.size), np.full(solid.size, 0.05)
    lo, hi = np.full(solid.size, 0.002), np.ones(solid.size)

    def bisection() -> float:
        low, high = 0.0, float(solid.sum())
        while high - low > 1e-12 * high:
            middle = (low + high) / 2
            excess = solid @ np.clip(target - u * middle, lo, hi) - middle
            low, high = (middle, high) if excess > 0 else (low, middle)
        return low

    times = interleaved(
        {
            "Newton": lambda: solve_moments(target, u[:, None], solid[:, None], lo, hi),
            "bisection": bisection,
            "copy": target.copy,
        },
        rounds=5,
    )
    return Report("Exact solve, 3.3 M patches", times, (at_least(times, "Newton", "bisection", 3),))
