"""Solid angles and areas of a panel's pixels on the screen."""

from collections.abc import Callable, Iterator

import numpy as np

from procam.arrays import Array
from procam.kernels import solid_angles

PanelField = Callable[[Array, Array], Array]
BLOCK = 1 << 16  # corners evaluated at a time


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
    width, height = size
    return solid_angles(_corner_blocks(size, directions), (height, width))


def panel_areas(size: tuple[int, int], points: PanelField) -> Array:
    """Areas (H, W) [m^2] of the pixels of a panel of `size` (W, H) on a screen of any shape.

    `points` returns the points (len(y), len(x), 3) [m] where the panel's points (x, y) [px] meet the
    screen, as `directions` of `panel_solid_angles` does.
    """
    width, height = size
    areas = np.empty((height, width))
    done, last = 0, np.empty((0, width + 1, 3))
    for block in _corner_blocks(size, points):
        rows = np.concatenate([last, block])
        areas[done : done + len(rows) - 1] = quad_areas(rows)
        done, last = done + len(rows) - 1, rows[-1:]
    return areas


def quad_areas(corners: Array) -> Array:
    """Areas (H, W) [m^2] of the cells of a grid of points (H + 1, W + 1, 3) [m] on a surface.

    Two flat triangles per cell: exact on a plane; on a surface with radius of curvature r, the area
    of a cell with diagonal d is low by about (d / r)^2 / 12. NaN corners give NaN.

    >>> corners = np.array([[[0.0, 0, 5], [2, 0, 5]], [[0, 3, 5], [2, 3, 5]]])
    >>> print(quad_areas(corners))
    [[6.]]
    """
    start, opposite = corners[:-1, :-1], corners[1:, 1:]
    upper = _triangle_areas(corners[:-1, 1:] - start, opposite - start)
    return upper + _triangle_areas(opposite - start, corners[1:, :-1] - start)


def _triangle_areas(first: Array, second: Array) -> Array:
    """Areas (...) of the triangles between edges (..., 3)."""
    return np.asarray(np.linalg.norm(np.cross(first, second), axis=-1)) / 2


def _corner_blocks(size: tuple[int, int], field: PanelField) -> Iterator[Array]:
    """A field at the corners of a panel's pixels, some rows (n, W + 1, 3) at a time."""
    width, height = size
    x, y = (np.arange(-0.5, n + 0.5, dtype=np.float64) for n in size)
    rows = max(1, BLOCK // (width + 1))
    for first in range(0, height + 1, rows):
        yield field(x, y[first : first + rows])
