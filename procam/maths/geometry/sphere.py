"""Directions, dome masters, spheres and solid angles (docs/theory/geometry.md).

Dome frame: right-handed, origin at the sphere's centre, z towards the pole of the cap, x to the
front, y to the audience's left. Azimuth is 0 at the front and positive to the left; elevation is
measured from the springline plane.
"""

import numpy as np
from numpy.typing import ArrayLike

from procam.arrays import AnyArray, Array, Array32, BoolArray, FloatArray

ARCMIN = np.degrees(1) * 60  # arcminutes in a radian


def direction_from_angles(azimuth: ArrayLike, elevation: ArrayLike) -> Array:
    """Unit directions (..., 3) from azimuth and elevation [rad]."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    horizontal = np.cos(elevation)
    return np.stack(
        [horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)], axis=-1
    )


def angles_from_direction(direction: Array) -> tuple[Array, Array]:
    """Azimuth and elevation [rad] of unit directions (..., 3)."""
    x, y, z = np.moveaxis(direction, -1, 0)
    return np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))


def normalise(vectors: Array) -> Array:
    """Vectors (..., 3) scaled to unit length."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def angle_between(first: Array, second: Array) -> Array:
    """Angles [rad] between unit directions (..., 3); accurate for small angles, unlike arccos."""
    return 2 * np.arcsin(np.clip(np.linalg.norm(first - second, axis=-1) / 2, 0, 1))


def master_directions(size: int, fov: float = np.pi) -> tuple[Array, BoolArray]:
    """Directions (N, N, 3) of an equidistant dome master's pixels, and which lie inside the circle.

    Front is at the bottom edge, left at the left. `fov` is the full field of view [rad].
    """
    xyz, _, inside = _master(size, fov, np.float64)
    return np.ascontiguousarray(np.moveaxis(xyz, 0, -1)), inside


def master_planes(size: int, fov: float = np.pi) -> tuple[Array32, Array32]:
    """Directions (3, N, N) and solid angles (N, N) [sr] of a master in single precision.

    Four times as fast as `master_directions` and `master_solid_angles`.
    """
    xyz, sinc, inside = _master(size, fov, np.float32)
    sinc *= np.float32((fov / size) ** 2)
    sinc *= inside
    return xyz, sinc


def _master(
    size: int, fov: float, dtype: type[np.floating]
) -> tuple[AnyArray, AnyArray, BoolArray]:
    """x, y, z (3, N, N) of a master's pixels; sin(theta) / theta of their polar angle; which lie inside."""
    offset = ((np.arange(size) - (size - 1) / 2) / (size / 2)).astype(dtype)
    quarter = offset[: (size + 1) // 2]  # the others mirror it
    q = np.sqrt(quarter[:, None] ** 2 + quarter**2)
    theta = q * dtype(fov / 2)
    sinc, inside = (_mirrored(plane, size) for plane in (np.sinc(theta / dtype(np.pi)), q <= 1))
    xyz = np.empty((3, size, size), dtype)
    scale = dtype(fov / 2)  # sin(theta) / q without a division by zero
    np.multiply(scale * offset[:, None], sinc, out=xyz[0])
    np.multiply(-scale * offset, sinc, out=xyz[1])
    _mirrored(np.cos(theta), size, xyz[2])
    return xyz, sinc, inside


def _mirrored(quarter: AnyArray, size: int, to: AnyArray | None = None) -> AnyArray:
    """A plane (N, N) that is symmetric in both directions, of its first rows and columns."""
    to = np.empty((size, size), quarter.dtype) if to is None else to
    half = len(quarter)
    to[:half, :half] = quarter
    to[:half, half:] = quarter[:, : size - half][:, ::-1]
    to[half:] = to[: size - half][::-1]
    return to


def master_pixels(direction: FloatArray, size: int, fov: float = np.pi) -> FloatArray:
    """Pixel coordinates (..., 2) as (column, row) of unit directions in a dome master.

    float32 directions give float32 pixels, accurate to 1e-3 px in an 8192 px master.
    """
    x, y, z = np.moveaxis(direction, -1, 0)
    horizontal = np.sqrt(x * x + y * y)
    scale = np.arctan2(horizontal, z) * direction.dtype.type(size / fov)
    scale /= np.where(horizontal > 0, horizontal, direction.dtype.type(1))
    centre = direction.dtype.type((size - 1) / 2)
    pixels = np.empty((*horizontal.shape, 2), direction.dtype)
    pixels[..., 0] = centre - scale * y
    pixels[..., 1] = centre + scale * x
    return pixels


def master_solid_angles(size: int, fov: float = np.pi) -> Array:
    """Solid angles (N, N) [sr] of dome-master pixels, 0 outside (docs/theory/geometry.md (G4))."""
    offset = (np.arange(size) - (size - 1) / 2) / (size / 2)
    theta = np.hypot(*np.meshgrid(offset, offset)) * fov / 2
    return np.where(theta <= fov / 2, np.sinc(theta / np.pi) * (fov / size) ** 2, 0.0)


def cap_solid_angle(half_angle: float) -> float:
    """Solid angle [sr] of a cap with half angle [rad].

    >>> round(cap_solid_angle(np.pi / 2) / np.pi, 9)
    2.0
    """
    return float(4 * np.pi * np.sin(half_angle / 2) ** 2)


def intersect_sphere(origin: Array, direction: Array, radius: float | Array) -> Array:
    """Points (..., 3) [m] where rays from inside meet a sphere around the origin; NaN if they miss.

    `origin` (..., 3) [m], unit `direction` (..., 3). The farther root (docs/theory/geometry.md (G1)),
    so that a device may stand on the sphere itself.
    """
    along = np.sum(origin * direction, axis=-1)
    outside = np.sum(origin * origin, axis=-1) - radius**2
    discriminant = along * along - outside
    root = np.sqrt(np.where(discriminant >= 0, discriminant, np.nan))
    return np.asarray(origin + (root - along)[..., None] * direction)
