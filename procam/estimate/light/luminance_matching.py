"""Luminance matching: the brightest white whose falloff is not visible.

A uniform white is as dim as the dimmest pixel. A white that falls off slowly enough is seen as uniform,
so the result is the largest white that stays below the available light and nowhere changes faster than a
limit (Majumder and Stevens 2005, doi:10.1145/1037957.1037964).
"""

from math import gcd

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import sample

CELLS = 128  # most cells along the edge of the dome master on which the limit is applied: 1.4 degrees each
# to neighbours, and back; the shortest path along these is at most 3 % longer than a straight one
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
MOST_ROUNDS = 4 * CELLS


def matched_white(hi: Array, lit: BoolArray, falloff_per_rad: float) -> Image:
    """Shape (N, N) of the white, its largest value 1.

    Parameters
    ----------
    hi : (N, N, C) direct light at full white. lit : (N, N) pixels that limit the white.
    falloff_per_rad : largest relative change of the white per radian, seen from the dome's centre; 0
        for a uniform white.

    Notes
    -----
    log w(x) = min over y of log hi(y) + g d(x, y), with g the limit and d the angle. One shape for all
    channels, for a change of hue would be visible. It is defined in unlit places too.
    """
    size = len(hi)
    if falloff_per_rad == 0 or not lit.any():
        return np.ones(lit.shape, np.float32)
    dimmest = np.where(lit, (hi / hi[lit].mean(axis=0)).min(axis=-1), np.inf)
    cells = gcd(size, CELLS)
    block = size // cells
    lowest = dimmest.reshape(cells, block, cells, block).min(axis=(1, 3))
    height = _limited_slope(np.log(np.maximum(lowest, 1e-9)), falloff_per_rad)
    shape = np.exp(height - height[np.isfinite(lowest)].max()).astype(np.float32)
    direction, _ = master_directions(size)
    return np.minimum(sample(shape, master_pixels(direction, cells), outside=1.0), 1.0)


def _limited_slope(height: Array, slope: float) -> Array:
    """The largest function (N, N) that is at most `height` and nowhere steeper than `slope` [1/rad]."""
    direction, _ = master_directions(len(height))
    steps = [(_shifted(dy, dx), _shifted(-dy, -dx)) for dy, dx in STEPS]
    rises = [
        slope * 2 * np.arcsin(np.linalg.norm(direction[a] - direction[b], axis=-1) / 2)
        for a, b in steps
    ]
    height = height.copy()
    for _ in range(MOST_ROUNDS):
        before = height.copy()
        for (a, b), rise in zip(steps, rises, strict=True):
            np.minimum(height[a], height[b] + rise, out=height[a])
            np.minimum(height[b], height[a] + rise, out=height[b])
        if np.array_equal(before, height):
            break
    return height


def _shifted(down: int, right: int) -> tuple[slice, slice]:
    """Slices of the pixels that are `down` and `right` of another pixel of the picture."""

    def part(step: int) -> slice:
        return slice(step, None) if step >= 0 else slice(None, step)

    return part(down), part(right)
