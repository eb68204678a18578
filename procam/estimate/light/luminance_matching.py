"""Luminance matching: the brightest white whose falloff nobody sees (Majumder & Stevens 2005).

Flattening to the dimmest pixel throws away what the rest of the dome could show. A white that falls off
slowly enough looks even: so the white is the largest that no place exceeds and that nowhere changes
faster than a limit.
"""

import numpy as np
from numpy.typing import NDArray

from procam.maths.geometry.sphere import master_directions, master_pixels
from procam.maths.warp import sample

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
CELLS = 128  # edge of the dome master that the limit is worked out on: 1.4 degrees
# to neighbours, both ways; along these any path is at most 3 % longer than the straight one
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))
MOST_ROUNDS = 4 * CELLS


def matched_white(hi: Array, lit: Mask, falloff_per_rad: float) -> Image:
    """Shape (N, N) of the white, its largest value 1; N a multiple of `CELLS`.

    Parameters
    ----------
    hi : (N, N, C) direct light at full white. lit : (N, N) where it counts.
    falloff_per_rad : most relative change of the white per radian seen from the dome's centre; 0 for
        an even white.

    Notes
    -----
    log w(x) = min over y of log hi(y) + g d(x, y). One shape for all colours: a change of colour would
    be seen. Where nothing is lit the shape goes on.
    """
    size = len(hi)
    if falloff_per_rad == 0 or not lit.any():
        return np.ones((size, size), np.float32)
    dimmest = np.where(lit, (hi / hi[lit].mean(axis=0)).min(axis=-1), np.inf)
    block = size // CELLS
    lowest = dimmest.reshape(CELLS, block, CELLS, block).min(axis=(1, 3))
    height = _relaxed(np.log(np.maximum(lowest, 1e-9)), falloff_per_rad)
    shape = np.exp(height - height[np.isfinite(lowest)].max()).astype(np.float32)
    direction, _ = master_directions(size)
    return np.minimum(sample(shape, master_pixels(direction, CELLS), outside=1.0), 1.0)


def _relaxed(height: Array, slope: float) -> Array:
    """The largest function (N, N) below `height` that is nowhere steeper than `slope` [1/rad]."""
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
    """The part of a picture that has a neighbour so far down and right, seen from the neighbour."""

    def part(step: int) -> slice:
        return slice(step, None) if step >= 0 else slice(None, step)

    return part(down), part(right)
