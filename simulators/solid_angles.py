"""Solid angles of cells between directions, apart from the kernels of procam."""

import numpy as np

from procam.arrays import Array


def triangle_solid_angles(a: Array, b: Array, c: Array) -> Array:
    """Signed solid angles [sr] of triangles with unit corners (..., 3).

    docs/theory/geometry.md (G3): Van Oosterom & Strackee 1983, doi:10.1109/TBME.1983.325207. The
    triple product uses edge differences, which avoids cancellation for small triangles.
    """
    triple = np.sum(a * np.cross(b - a, c - a), axis=-1)
    denominator = 1 + np.sum(a * b, -1) + np.sum(b * c, -1) + np.sum(c * a, -1)
    return np.asarray(2 * np.arctan2(triple, denominator))


def grid_solid_angles(corners: Array) -> Array:
    """Solid angles (H, W) [sr] of the cells of a grid of unit corner directions (H+1, W+1, 3).

    Unsigned; two great-circle triangles per cell. The pixel edges of an off-centre projector are
    small circles: a relative error per pixel of 1.6e-4 for 64 pixels across and 6e-7 for 1024
    (docs/theory/geometry.md, G3). NaN corners give NaN.
    """
    top_left, top_right = corners[:-1, :-1], corners[:-1, 1:]
    bottom_left, bottom_right = corners[1:, :-1], corners[1:, 1:]
    upper = triangle_solid_angles(top_left, top_right, bottom_right)
    lower = triangle_solid_angles(top_left, bottom_right, bottom_left)
    return np.asarray(np.abs(upper + lower))
