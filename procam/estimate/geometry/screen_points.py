"""Points on a screen for whole images of rays, block by block."""

from collections.abc import Callable

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray
from procam.maths.geometry.lenses import project_before_fold
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.model.optics import ProjectorModel

BLOCK = 1 << 16  # rays at a time: harmonics of a whole image would not fit in memory


def intersect_screen(shape: RoundShape, origin: Array, rays: Array) -> Array:
    """Points (..., 3) [m] where rays (..., 3) from origins (3,) or (..., 3) meet the screen."""
    starts = np.broadcast_to(origin, rays.shape).reshape(-1, 3)
    flat = rays.reshape(-1, 3)
    return _in_blocks(lambda block: shape.intersect(starts[block], flat[block]), rays.shape)


def screen_points(shape: RoundShape, direction: FloatArray) -> Array:
    """Points (..., 3) [m] of the screen in unit directions (..., 3) from its centre."""
    flat = direction.reshape(-1, 3).astype(float)
    return _in_blocks(
        lambda block: shape.radius_at(flat[block])[:, None] * flat[block], direction.shape
    )


def seen_points(shape: RoundShape, origin: Array, points: Array) -> BoolArray:
    """Whether nothing of the screen is between an origin (3,) and points (..., 3) of it."""
    flat = points.reshape(-1, 3)
    out = np.empty(len(flat), bool)
    for at in range(0, len(flat), BLOCK):
        out[at : at + BLOCK] = shape.sees(origin, flat[at : at + BLOCK])
    return out.reshape(points.shape[:-1])


def panel_pixels(shape: RoundShape, projector: ProjectorModel, points: Array) -> Array:
    """Panel pixels (..., 2) that light points (..., 3) of the screen; NaN of what is hidden from the lens."""
    pose = projector.projector_from_dome
    place = project_before_fold(pose.apply(points), projector.lens)
    place[~seen_points(shape, pose.origin, points)] = np.nan
    return place


def _in_blocks(work: Callable[[slice], Array], shape: tuple[int, ...]) -> Array:
    out = np.empty((int(np.prod(shape[:-1])), 3))
    for at in range(0, len(out), BLOCK):
        block = slice(at, at + BLOCK)
        out[block] = work(block)
    return out.reshape(shape)
