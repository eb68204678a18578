"""The projection screen: a dome, or a mesh of any shape."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array
from procam.errors import InputError, ShapeError, UnitError


@dataclass(frozen=True, slots=True)
class Dome:
    """A spherical cap about the dome frame's origin, its pole on z.

    Attributes
    ----------
    radius_m : sphere radius [m].
    half_angle : angle from the pole to the rim of the whole screen, lit or not [rad].
    tilt : angle between the pole and the vertical, positive towards the front [rad].
    floor_albedo, floor_albedo_sigma : diffuse reflectance of the floor under the dome [-]; in a
        calibration, of one in the plane of the rim's lowest point that returns as much light. It enters
        the albedo only, never the compensation.
    bumps : harmonic coefficients of the radius from degree 2 to `degree`, relative to the radius;
        none for a sphere.
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
            raise UnitError(f"radius_m is {self.radius_m}; it needs a length above 0 metres")
        if not 0 < self.half_angle < 3.1416:
            raise UnitError(
                f"half_angle is {self.half_angle} rad; it needs an angle between 0 and pi"
            )


@dataclass(frozen=True, slots=True, eq=False)
class MeshScreen:
    """A screen of any shape as triangles in the dome frame: cylinder, box, faceted or scanned dome.

    Equality is identity, so that a ray tracer can be cached for each screen.

    Attributes
    ----------
    vertices : (V, 3) float64 [m].
    faces : (F, 3) int32 indices of vertices, counter-clockwise seen from the inside, where the
        devices and the audience are.
    smooth : the mesh samples a smooth surface, such as a scanned dome; else its faces are flat.
    """

    vertices: Array
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
                raise InputError(f"{name} has type {array.dtype}; it needs {np.dtype(dtype)}")
        if not np.isfinite(self.vertices).all():
            raise InputError(
                "vertices contain NaN or infinity; they need finite coordinates in metres"
            )
        if self.faces.min() < 0 or self.faces.max() >= len(self.vertices):
            raise InputError(
                f"faces refer to vertices {self.faces.min()} to {self.faces.max()}; the mesh has vertices "
                f"0 to {len(self.vertices) - 1}"
            )
