"""The screen: what the light lands on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError, UnitError


@dataclass(frozen=True, slots=True)
class Dome:
    """A spherical cap round the dome frame's origin, its pole on z.

    Attributes
    ----------
    radius_m : sphere radius [m].
    half_angle : angle from the pole to the rim of all that is screen, lit or not [rad].
    tilt : how far the pole leans towards the front, off gravity's vertical [rad].
    floor_albedo, floor_albedo_sigma : what is known of the deck under the dome, diffuse
        reflectance [-]; it enters the albedo only, never the compensation.
    bumps : harmonics of the radius from degree 2 to `degree`, relative to it; none for a sphere.
    """

    radius_m: float
    half_angle: float
    tilt: float = 0.0
    floor_albedo: float = 0.0
    floor_albedo_sigma: float = 0.0
    bumps: tuple[float, ...] = ()
    degree: int = 0

    def __post_init__(self) -> None:
        if not self.radius_m > 0:  # also refuses NaN
            raise UnitError(f"radius_m: got {self.radius_m}, expected more than 0 metres")
        if not 0 < self.half_angle < 3.1416:
            raise UnitError(f"half_angle: got {self.half_angle} rad, expected between 0 and pi")


@dataclass(frozen=True, slots=True, eq=False)
class MeshScreen:
    """A screen of any shape as triangles in the dome frame: cylinder, box, faceted or scanned dome.

    Two are equal only if they are the same object, so that a tracer can be kept for each.

    Attributes
    ----------
    vertices : (V, 3) float64 [m].
    faces : (F, 3) int32 indices of vertices, counter-clockwise seen from the inside, where the
        devices and the audience are.
    smooth : the mesh samples a smooth surface, such as a scanned dome; else its faces are flat.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    smooth: bool = False

    def __post_init__(self) -> None:
        for name, array, dtype in (
            ("vertices", self.vertices, np.float64),
            ("faces", self.faces, np.int32),
        ):
            if array.ndim != 2 or array.shape[1] != 3 or not len(array):
                raise ShapeError(name, array.shape, "(n, 3) with n of 1 or more")
            if array.dtype != dtype:
                raise InputError(f"{name}: got {array.dtype}, expected {np.dtype(dtype)}")
        if not np.isfinite(self.vertices).all():
            raise InputError("vertices: got NaN or infinite ones, expected finite metres")
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise InputError(
                f"faces: got vertices {self.faces.min()} to {self.faces.max()}, expected "
                f"0 to {len(self.vertices) - 1}"
            )
