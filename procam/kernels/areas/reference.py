"""Solid angles of quadrilateral cells in NumPy: the reference implementation of `areas`."""

import numpy as np

from procam.arrays import Array


def solid_angles(corners: Array) -> Array:
    """See `procam.kernels.solid_angles`; all corners (H + 1, W + 1, 3) at once."""
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    return np.abs(_triangle_solid_angles(a, b, c) + _triangle_solid_angles(a, c, d))


def _triangle_solid_angles(a: Array, b: Array, c: Array) -> Array:
    """tan(area / 2) = a.((b - a) x (c - a)) / (1 + a.b + b.c + c.a), signed."""
    triple = (a * np.cross(b - a, c - a)).sum(axis=-1)
    denominator = 1 + (a * b).sum(axis=-1) + (b * c).sum(axis=-1) + (c * a).sum(axis=-1)
    return 2 * np.arctan2(triple, denominator)
