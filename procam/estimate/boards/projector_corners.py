"""Projector pixels of board corners, from the correspondence map around each (Moreno & Taubin 2012).

doi:10.1109/3DIMPVT.2012.77
"""

import numpy as np
from scipy.linalg import rq
from scipy.spatial import KDTree

from procam.arrays import Array
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.model.correspondence import CorrespondenceMap

WINDOW = 1.0  # radius, over the distance to the nearest corner: the window stays on the board
MIN_PIXELS = 40  # of a window
MAX_OFFSET = 0.35  # of the mean of a window's pixels from its corner, over its radius
REWEIGHTINGS = 4
OUTLIER_DISTANCE = 4.0  # over the median distance from the middle; a window's edge is at 2 or 3


def projector_corners(found: CorrespondenceMap, camera_px: Array) -> Array:
    """Projector pixels (N, 2) of board corners at camera pixels (N, 2); NaN where not lit.

    A homography is fitted to the map within a window around each corner, which averages the map's
    rounding and follows the lenses' distortion. The window reaches to the nearest corner.
    """
    rows, columns = np.nonzero(found.valid)
    if not len(rows):
        return np.full_like(camera_px, np.nan)
    pixels = np.stack([columns, rows], axis=1).astype(float)
    xy = found.projector_xy[found.valid].astype(float)
    radius = WINDOW * np.asarray(KDTree(camera_px).query(camera_px, 2)[0])[:, 1]
    near = KDTree(pixels).query_ball_point(camera_px, radius)
    corners = [
        _at_corner((pixels[index] - corner) / reach, xy[index])
        for index, corner, reach in zip(near, camera_px, radius, strict=True)
    ]
    return np.array(corners)


def _at_corner(offset: Array, xy: Array) -> Array:
    """Projector pixel (2,) at the centre of a window, from offsets (n, 2) [radii] and their xy (n, 2)."""
    if len(offset) < MIN_PIXELS or np.linalg.norm(offset.mean(axis=0)) > MAX_OFFSET:
        return np.full(2, np.nan)
    middle = np.median(xy, axis=0)
    away = np.abs(xy - middle)
    # misread pixels lie anywhere
    inside = (away <= OUTLIER_DISTANCE * np.median(away, axis=0) + 1).all(axis=1)
    size = max(float(away[inside].max()), 1.0)
    target = (xy[inside] - middle) / size
    source = np.c_[offset[inside], np.ones(len(target))]
    weight = np.ones(len(source))
    for _ in range(REWEIGHTINGS):
        matrix = direct_linear_transform(source, target, weight)
        ahead = source @ matrix.T
        miss = np.linalg.norm(ahead[:, :2] / ahead[:, 2:] - target, axis=1)
        weight = 1 / np.maximum(miss, 2 * np.median(miss) + 1e-9)
    return np.asarray(matrix[:2, 2] / matrix[2, 2] * size + middle)


def direct_linear_transform(source: Array, target: Array, weight: Array) -> Array:
    """Matrix (3, M) by the direct linear transform: (target (N, 2), 1) ~ matrix source (N, M)."""
    zero = np.zeros_like(source)
    rows = np.r_[
        np.c_[source, zero, -target[:, :1] * source], np.c_[zero, source, -target[:, 1:] * source]
    ]
    rows = rows * np.r_[weight, weight][:, None]
    return np.asarray(np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, source.shape[1]))


def resect_pinhole(points: Array, pixels: Array, size: tuple[int, int]) -> tuple[Lens, Pose] | None:
    """Lens and pose of a pinhole whose pixels (N, 2) see points (N, 3) [m]; None if it sees them mirrored.

    The direct linear transform (Hartley & Zisserman, s. 7.1) needs no initial principal point, which lens
    shift may put outside the panel of `size` (width, height).
    """
    middle, scale = points.mean(axis=0), float(points.std())
    source = np.c_[(points - middle) / scale, np.ones(len(points))]
    half = np.array(size) / 2
    matrix = direct_linear_transform(source, (pixels - half) / half.max(), np.ones(len(source)))
    matrix = matrix * np.sign(np.median(source @ matrix[2]))
    triangle, rotation = rq(matrix[:, :3])
    sign = np.diag(np.sign(np.diag(triangle)))
    triangle, rotation = triangle @ sign, sign @ rotation
    if np.linalg.det(rotation) < 0:
        return None
    shift = np.linalg.solve(triangle, matrix[:, 3]) * scale - rotation @ middle
    triangle = triangle / triangle[2, 2] * half.max()
    lens = Lens("brown", np.diag(triangle)[:2], triangle[:2, 2] + half, np.zeros(5))
    return lens, Pose(rotation, shift)
