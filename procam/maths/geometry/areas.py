"""Solid angles and areas of a panel's pixels on the screen."""

from collections.abc import Callable

import numpy as np

from procam.arrays import Array

PanelField = Callable[[Array, Array], Array]
BLOCK = 1 << 14  # corners at a time, whose intermediate arrays stay in the cache


def panel_solid_angles(size: tuple[int, int], directions: PanelField) -> Array:
    """Solid angles (H, W) [sr] of a panel's pixels, as seen from one point.

    Parameters
    ----------
    size : (W, H) of the panel.
    directions : function of x and y [px] that returns unit directions (len(y), len(x), 3), float64,
        from that point to where the panel's points (x, y) meet the screen; NaN where they miss. It
        is called for a few rows at a time, so that the corners of a whole panel are never in memory.

    Returns
    -------
    (H, W) [sr]; NaN where a corner misses. The edges are taken as great circles. Seen from an
    off-centre projector they are small circles: a relative error of 1.6e-4 per pixel for a panel 64
    pixels wide, 6e-7 for 1024 (docs/theory/geometry.md (G3)).
    """
    return panel_areas(size, directions, _cell_solid_angles)


def panel_areas(
    size: tuple[int, int], places: PanelField, of_cells: Callable[[Array], Array]
) -> Array:
    """Areas (H, W) of a panel's pixels, by a function of the corners (3, h + 1, w + 1) of some of them."""
    width, height = size
    x, y = (np.arange(-0.5, n + 0.5) for n in size)
    rows, done = max(1, BLOCK // (width + 1)), 0
    areas, last = np.empty((height, width)), np.empty((3, 0, width + 1))
    for first in range(0, height + 1, rows):
        block = np.moveaxis(places(x, y[first : first + rows]), -1, 0)
        corners = np.concatenate([last, block], axis=1)
        end = done + corners.shape[1] - 1
        areas[done:end] = of_cells(corners)
        done, last = end, corners[:, -1:]
    return areas


def _cell_solid_angles(corners: Array) -> Array:
    """Solid angles (h, w) [sr] of the cells of a grid of unit directions (3, h + 1, w + 1), unsigned.

    Two great-circle triangles per cell (docs/theory/geometry.md (G3): Van Oosterom & Strackee 1983,
    doi:10.1109/TBME.1983.325207). The triple products use edge differences, which avoids cancellation for
    small cells.
    """
    a, b = corners[:, :-1, :-1], corners[:, :-1, 1:]
    d, c = corners[:, 1:, :-1], corners[:, 1:, 1:]
    right, across, down = b - a, c - a, d - a
    diagonal = 1 + _dot(a, c)
    upper = np.arctan2(_triple(a, right, across), diagonal + _dot(a, b) + _dot(b, c))
    lower = np.arctan2(_triple(a, across, down), diagonal + _dot(a, d) + _dot(d, c))
    return np.asarray(2 * np.abs(upper + lower))


def cell_areas(corners: Array) -> Array:
    """Areas (h, w) [m^2] of the cells of a grid of points (3, h + 1, w + 1), as two flat triangles each."""
    a, b = corners[:, :-1, :-1], corners[:, :-1, 1:]
    d, c = corners[:, 1:, :-1], corners[:, 1:, 1:]
    return _triangle_areas(b - a, c - a) + _triangle_areas(c - a, d - a)


def _triangle_areas(one: Array, other: Array) -> Array:
    return np.asarray(np.linalg.norm(np.cross(one, other, axis=0), axis=0) / 2)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _triple(a: Array, b: Array, c: Array) -> Array:
    """A . (b x c)."""
    return np.asarray(
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
