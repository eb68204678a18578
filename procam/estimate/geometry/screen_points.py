"""Points on a round screen for whole pictures of rays, a part at a time."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from procam.maths.geometry.ray_to_screen import RoundShape
from procam.model.screen import Dome

Array = NDArray[np.float64]
PART = 1 << 16  # rays at a time: harmonics of a whole picture would fill the memory


def round_shape(dome: Dome) -> RoundShape:
    """The shape of a dome as it was solved."""
    return RoundShape(dome.radius_m, np.array(dome.bumps), dome.degree)


def intersect_screen(shape: RoundShape, origin: Array, rays: Array) -> Array:
    """Points (..., 3) [m] where rays (..., 3) from places (3,) or (..., 3) meet the screen."""
    starts = np.broadcast_to(origin, rays.shape).reshape(-1, 3)
    flat = rays.reshape(-1, 3)
    return _by_parts(lambda part: shape.meet(starts[part], flat[part]), rays.shape)


def screen_points(shape: RoundShape, direction: NDArray[np.floating]) -> Array:
    """Points (..., 3) [m] of the screen in unit directions (..., 3) from its centre."""
    flat = direction.reshape(-1, 3).astype(float)
    return _by_parts(lambda part: shape.reach(flat[part])[:, None] * flat[part], direction.shape)


def _by_parts(work: Callable[[slice], Array], shape: tuple[int, ...]) -> Array:
    out = np.empty((int(np.prod(shape[:-1])), 3))
    for at in range(0, len(out), PART):
        part = slice(at, at + PART)
        out[part] = work(part)
    return out.reshape(shape)
