"""Lenses of a camera and a projector and the pose between them, from views of a flat board.

The projector is an inverse camera. The camera finds the board's corners in the white picture; local
homographies of the correspondence map around each corner give its projector pixel (Moreno & Taubin
2012, doi:10.1109/3DIMPVT.2012.77). One board adjustment then solves both lenses, the pose between
them and all board poses. Boards that fill little of the picture determine the distortion at the
lenses' edges poorly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import rq
from scipy.spatial import KDTree

from procam.arrays import Array
from procam.errors import CalibrationError, NotEnoughData, ShapeError
from procam.estimate.boards.corners import BoardRig, Corners, residuals, stack_corners
from procam.estimate.boards.robust_fit import (
    IDENTITY,
    MIN_CORNERS,
    BoardFit,
    DroppedCorner,
    check_count,
    check_focal,
    check_tilts,
    determines_pose,
    dropped_corners,
)
from procam.estimate.boards.start import start_camera
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.model.correspondence import CorrespondenceMap

PINHOLE, BROWN = tuple(range(4)), tuple(range(9))
WINDOW = 1.0  # radius, over the distance to the nearest corner: the window stays on the board
MIN_PIXELS = 40  # of a window
MAX_OFFSET = 0.35  # of the mean of a window's pixels from its corner, over its radius
REWEIGHTINGS = 4
OUTLIER_DISTANCE = 4.0  # over the median distance from the middle; a window's edge is at 2 or 3
DEVICES = ("camera", "projector")


@dataclass(frozen=True, slots=True)
class PairView:
    """One pose of the board, observed by both devices.

    Attributes
    ----------
    name : of the session.
    points : (N, 3) corners on the flat board, z = 0 [m].
    camera_px : (N, 2) their camera pixels [px].
    projector_px : (N, 2) the projector pixels that light them [px]; NaN where unknown.
    """

    name: str
    points: Array
    camera_px: Array
    projector_px: Array


@dataclass(frozen=True, slots=True)
class PlanarPair:
    """A solved pair.

    Attributes
    ----------
    camera, projector : lenses.
    projector_from_camera : pose between them [m].
    covariance : (S, S) of the camera's lens parameters, the projector's, then the rotation [rad] and
        translation [m] of `projector_from_camera`; a lens's are fx, fy, cx, cy [px] and, if they
        were solved for, k1, k2, p1, p2, k3.
    boards : camera_from_board per view.
    residual_px : per device, "camera" and "projector", and view: predicted minus observed (N, 2).
    dropped : outliers per device.
    """

    camera: Lens
    projector: Lens
    projector_from_camera: Pose
    covariance: Array
    boards: dict[str, Pose]
    residual_px: dict[str, dict[str, Array]]
    dropped: dict[str, tuple[DroppedCorner, ...]]


def pair_view(name: str, points: Array, camera_px: Array, found: CorrespondenceMap) -> PairView:
    """A view from corners (N, 3) [m] at camera pixels (N, 2) and a decoded correspondence map."""
    return PairView(name, points, camera_px, projector_corners(found, camera_px))


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


def fit_planar_pair(
    views: Sequence[PairView],
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
    *,
    distortion: bool = False,
) -> PlanarPair:
    """Solve both lenses and the pose between them from three or more views of a flat board.

    Sizes are (width, height) [px]. `distortion` frees the Brown terms of both lenses.

    Raises
    ------
    NotEnoughData
        Too few views or corners, or parallel boards.
    CalibrationError
        The projector's picture is mirrored. DidNotConverge : the fit did not reach a minimum.
    """
    _check(views, projector_size)
    free = BROWN if distortion else PINHOLE
    corners = stack_corners(
        [v.points for v in views], [np.stack([v.camera_px, v.projector_px]) for v in views]
    )
    first = replace(corners, pixels=corners.pixels[:1], use=corners.use[:1])
    camera = BoardFit((free,)).fit_robustly(
        first, _undistorted(start_camera("brown", camera_size, first))
    )
    check_tilts(camera)
    first, camera = BoardFit((free,)).fit_inliers(first, camera)
    start = _with_projector(replace(corners, use=corners.use & first.use), camera, projector_size)
    both = BoardFit((free, free))
    rig, _ = both.adjustment(corners, start, robust=True).solve(start)
    kept, rig = both.fit_inliers(corners, rig)
    covariance = both.adjustment(kept, rig).covariance(rig)
    check_focal(rig.lenses[0], covariance)
    check_focal(rig.lenses[1], covariance[len(free) :, len(free) :])
    return _result(views, corners, kept, rig, covariance)


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
        matrix = _projection(source, target, weight)
        ahead = source @ matrix.T
        miss = np.linalg.norm(ahead[:, :2] / ahead[:, 2:] - target, axis=1)
        weight = 1 / np.maximum(miss, 2 * np.median(miss) + 1e-9)
    return np.asarray(matrix[:2, 2] / matrix[2, 2] * size + middle)


def _projection(source: Array, target: Array, weight: Array) -> Array:
    """Matrix (3, M) by the direct linear transform: (target (N, 2), 1) ~ matrix source (N, M)."""
    zero = np.zeros_like(source)
    rows = np.r_[
        np.c_[source, zero, -target[:, :1] * source], np.c_[zero, source, -target[:, 1:] * source]
    ]
    rows = rows * np.r_[weight, weight][:, None]
    return np.asarray(np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, source.shape[1]))


def _undistorted(rig: BoardRig) -> BoardRig:
    lens = rig.lenses[0]
    return replace(rig, lenses=(replace(lens, distortion=np.zeros_like(lens.distortion)),))


def _with_projector(corners: Corners, camera: BoardRig, size: tuple[int, int]) -> BoardRig:
    """`camera` with the projector's initial lens and pose, by resection (Hartley & Zisserman, s. 7.1).

    The direct linear transform needs no initial principal point, which lens shift may put outside
    the panel.
    """
    use = corners.use[0] & corners.use[1]
    views = zip(camera.boards, corners.views, strict=True)
    points = np.concatenate([board.apply(corners.points[view]) for board, view in views])[use]
    middle, scale = points.mean(axis=0), float(points.std())
    source = np.c_[(points - middle) / scale, np.ones(len(points))]
    half = np.array(size) / 2
    target = (corners.pixels[1][use] - half) / half.max()
    matrix = _projection(source, target, np.ones(len(source)))
    matrix = matrix * np.sign(np.median(source @ matrix[2]))
    triangle, rotation = rq(matrix[:, :3])
    sign = np.diag(np.sign(np.diag(triangle)))
    triangle, rotation = triangle @ sign, sign @ rotation
    if np.linalg.det(rotation) < 0:
        raise CalibrationError(
            "projector: its picture is mirrored; switch off rear projection and flip in its menu"
        )
    shift = np.linalg.solve(triangle, matrix[:, 3]) * scale - rotation @ middle
    triangle = triangle / triangle[2, 2] * half.max()
    lens = Lens("brown", np.diag(triangle)[:2], triangle[:2, 2] + half, np.zeros(5))
    lenses, devices = (*camera.lenses, lens), (IDENTITY, Pose(rotation, shift))
    return BoardRig(lenses, devices, camera.boards, camera.bend)


def _result(
    views: Sequence[PairView], corners: Corners, kept: Corners, rig: BoardRig, covariance: Array
) -> PlanarPair:
    error = residuals(kept, rig)
    residual: dict[str, dict[str, Array]] = {}
    dropped: dict[str, tuple[DroppedCorner, ...]] = {}
    for device, name in enumerate(DEVICES):
        parts = zip(views, corners.views, strict=True)
        residual[name] = {v.name: error[device, part][kept.use[device, part]] for v, part in parts}
        lists = (
            dropped_corners(corners, kept, error[device], (device, i), v.name)
            for i, v in enumerate(views)
        )
        dropped[name] = tuple(corner for found in lists for corner in found)
    return PlanarPair(
        rig.lenses[0],
        rig.lenses[1],
        rig.devices[1],
        covariance,
        {v.name: board for v, board in zip(views, rig.boards, strict=True)},
        residual,
        dropped,
    )


def _check(views: Sequence[PairView], projector_size: tuple[int, int]) -> None:
    check_count(views, 6)
    for view in views:
        for name, pixels in zip(DEVICES, (view.camera_px, view.projector_px), strict=True):
            if pixels.shape != (len(view.points), 2):
                raise ShapeError(
                    f"{view.name}: {name} pixels", pixels.shape, "(N, 2) like its points"
                )
        lit = np.asarray(np.isfinite(view.projector_px).all(axis=1), np.bool_)
        if not determines_pose(view.points[lit]):
            raise NotEnoughData(
                f"{view.name}: the projector lights {int(lit.sum())} of {len(lit)} corners; at least "
                f"{MIN_CORNERS} over an area are needed. Let the picture of "
                f"{projector_size[0]}x{projector_size[1]} cover the board"
            )
