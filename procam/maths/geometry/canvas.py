"""The dome master that content is drawn on."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Array32, BoolArray, FloatArray
from procam.maths.geometry.sphere import (
    master_directions,
    master_pixels,
    master_planes,
    master_solid_angles,
)


@dataclass(frozen=True, slots=True)
class Canvas:
    """An equidistant, square dome master (docs/theory/geometry.md, "Dome master").

    Attributes
    ----------
    fov : full field of view, from edge to edge [rad].
    rotation : azimuth at which its bottom edge is shown, positive to the left [rad].
    """

    fov: float = np.pi
    rotation: float = 0.0

    def shape(self, size: int) -> tuple[int, int]:
        """Rows and columns of a picture of that edge."""
        return size, size

    def directions(self, size: int) -> tuple[Array, BoolArray]:
        """Directions (N, N, 3) of the pixels, and which lie inside the circle."""
        direction, inside = master_directions(size, self.fov)
        return np.ascontiguousarray(turned(direction, self.rotation)), inside

    def planes(self, size: int) -> tuple[Array32, Array32]:
        """Directions (3, N, N) and solid angles (N, N) [sr] in single precision."""
        direction, area = master_planes(size, self.fov)
        if self.rotation:
            direction = np.moveaxis(turned(np.moveaxis(direction, 0, -1), self.rotation), -1, 0)
        return np.ascontiguousarray(direction), area

    def pixels(self, direction: FloatArray, size: int) -> FloatArray:
        """Pixel coordinates (..., 2) as (column, row) of unit directions (..., 3)."""
        return master_pixels(turned(direction, -self.rotation), size, self.fov)

    def weights(self, size: int) -> Array:
        """Solid angles (N, N) [sr] of the pixels, 0 outside the circle."""
        return master_solid_angles(size, self.fov)


STANDARD = Canvas()  # 180 degrees, the front at the bottom edge: that of a calibration's maps


def turned(direction: FloatArray, angle: float) -> FloatArray:
    """Directions (..., 3) turned about the pole [rad], to the left; the same array for no angle."""
    if not angle:
        return direction
    kind = direction.dtype.type
    cos, sin = kind(np.cos(angle)), kind(np.sin(angle))
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
