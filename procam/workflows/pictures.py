"""Content to try a dome with."""

import numpy as np
from numpy.typing import NDArray

from procam.maths.sphere import angles_from_direction, master_directions

Image = NDArray[np.float32]
HORIZON = np.radians(30.0)
TREE_SPACING = np.radians(45.0)


def half_sky(size: int) -> Image:
    """A bright sky over a darker ground, split by elevation, with black trees: (N, N, 3) linear.

    The sky's light falls on the ground by way of the dome; the trees ask for less light than
    that, which no projector can give.
    """
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    height = np.clip((elevation - HORIZON) / (np.pi / 2 - HORIZON), 0, 1)[..., None]
    sky = (1 - height) * np.array([0.62, 0.72, 0.85]) + height * np.array([0.30, 0.45, 0.80])
    furrow = 0.5 + 0.5 * np.cos(24 * azimuth) * np.cos(elevation / HORIZON * np.pi)
    ground = np.array([0.30, 0.27, 0.20]) * (0.85 + 0.5 * furrow)[..., None]
    from_trunk = np.abs((azimuth / TREE_SPACING) % 1 - 0.5) * TREE_SPACING * np.cos(elevation)
    tree = _soft_step(np.radians(4) - from_trunk) * _soft_step(0.8 * HORIZON - elevation)
    ground = ground * (1 - tree[..., None]) + 0.02 * tree[..., None]
    above = _soft_step(elevation - HORIZON)[..., None]
    picture = above * sky + (1 - above) * ground
    return (picture * inside[..., None]).astype(np.float32)


def _soft_step(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """0 to 1 over two degrees: an edge that any projector can draw."""
    x = np.clip(angle / np.radians(2.0) + 0.5, 0, 1)
    return np.asarray(x * x * (3 - 2 * x))
