"""Lenses of a camera and a projector and the pose between them, from views of a flat board.

The projector is an inverse camera. The camera finds the board's corners in the white picture; local
homographies of the correspondence map around each corner give its projector pixel (Moreno & Taubin
2012, doi:10.1109/3DIMPVT.2012.77). One board adjustment then solves both lenses, the pose between
them and all board poses. Poses left out of the fit decide whether it solves for the lenses' distortion
and for the bend of the board.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array
from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.boards.corners import BoardRig, Corners, residuals, stack_corners
from procam.estimate.boards.left_out import best_model, held_out_residuals, jackknife_covariance
from procam.estimate.boards.projector_corners import projector_corners, resect_pinhole
from procam.estimate.boards.robust_fit import (
    IDENTITY,
    MIN_CORNERS,
    MIN_VIEWS,
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

POSE_TERMS = 6
PINHOLE, BROWN = tuple(range(4)), tuple(range(9))
FOLDS = 10  # of the cross-validation; of fewer poses each is left out on its own
DEVICES = ("camera", "projector")
MODELS = tuple(BoardFit((free, free), bend) for free in (PINHOLE, BROWN) for bend in (False, True))


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
        were solved for, k1, k2, p1, p2, k3. Errors of the model are in it.
    bend : (3,) as in `BoardRig` [m]; zeros if poses left out are predicted better by a flat board.
    area : (2, 2) lowest and highest x, y of the board's corners [m]; `bend` refers to it.
    boards : camera_from_board per fitted view.
    residual_px : per device, "camera" and "projector", and view: predicted minus observed (N, 2).
    held_out_px : the same for each view in a fit without it, of which only the board's pose is fitted.
    dropped : outliers per device. dropped_views : views of which a device's corners are all rejected.
    """

    camera: Lens
    projector: Lens
    projector_from_camera: Pose
    covariance: Array
    bend: Array
    area: Array
    boards: dict[str, Pose]
    residual_px: dict[str, dict[str, Array]]
    held_out_px: dict[str, dict[str, Array]]
    dropped: dict[str, tuple[DroppedCorner, ...]]
    dropped_views: tuple[str, ...]


def pair_view(name: str, points: Array, camera_px: Array, found: CorrespondenceMap) -> PairView:
    """A view from corners (N, 3) [m] at camera pixels (N, 2) and a decoded correspondence map."""
    return PairView(name, points, camera_px, projector_corners(found, camera_px))


def fit_planar_pair(
    views: Sequence[PairView], camera_size: tuple[int, int], projector_size: tuple[int, int]
) -> PlanarPair:
    """Solve both lenses and the pose between them from three or more views of a flat board.

    Sizes are (width, height) [px]. Distortion and bend are solved for if that predicts views left out
    of the fit better.

    Raises
    ------
    NotEnoughData
        Too few views or corners, or parallel boards.
    CalibrationError
        The projector's picture is mirrored. DidNotConverge : the fit did not reach a minimum.
    """
    _check(views, projector_size)
    corners = stack_corners(
        [v.points for v in views], [np.stack([v.camera_px, v.projector_px]) for v in views]
    )
    richest = MODELS[-1]
    start = _start(corners, camera_size, projector_size)
    rig, _ = richest.adjustment(corners, start, robust=True).solve(start)
    kept, rig = richest.fit_inliers(corners, rig)
    model, rig = best_model(MODELS, kept.only(_used(kept)), rig, FOLDS)
    kept, rig = model.fit_inliers(corners, rig)
    kept = kept.only(_used(kept))
    _check_used(kept)
    adjustment, terms = model.adjustment(kept, rig), len(model.free[0])
    noise = adjustment.covariance(rig)
    check_focal(rig.lenses[0], noise)
    check_focal(rig.lenses[1], noise[terms:, terms:])
    shared = 2 * terms + POSE_TERMS
    covariance = jackknife_covariance(adjustment, rig)[:shared, :shared]
    left_out = held_out_residuals(model, kept, rig, FOLDS)
    return _result([v.name for v in views], corners, kept, rig, (covariance, left_out))


def _start(
    corners: Corners, camera_size: tuple[int, int], projector_size: tuple[int, int]
) -> BoardRig:
    """The camera solved on its own, and the projector's initial lens and pose."""
    model = BoardFit(MODELS[-1].free[:1], bend=True)
    first = replace(corners, pixels=corners.pixels[:1], use=corners.use[:1])
    camera = model.fit_robustly(first, start_camera("brown", camera_size, first))
    check_tilts(camera)
    first, camera = model.fit_inliers(first, camera)
    return _with_projector(replace(corners, use=corners.use & first.use), camera, projector_size)


def _with_projector(corners: Corners, camera: BoardRig, size: tuple[int, int]) -> BoardRig:
    """`camera` with the projector's initial lens and pose, by resection."""
    use = corners.use[0] & corners.use[1]
    views = zip(camera.boards, corners.views, strict=True)
    points = np.concatenate([board.apply(corners.points[view]) for board, view in views])[use]
    found = resect_pinhole(points, corners.pixels[1][use], size)
    if found is None:
        raise CalibrationError(
            "projector: its picture is mirrored; switch off rear projection and flip in its menu"
        )
    lens, pose = found
    lenses, devices = (*camera.lenses, lens), (IDENTITY, pose)
    return BoardRig(lenses, devices, camera.boards, camera.bend)


def _result(
    names: Sequence[str],
    corners: Corners,
    kept: Corners,
    rig: BoardRig,
    judged: tuple[Array, Array],
) -> PlanarPair:
    """A pair from its fit; `judged` are its covariance and the residuals (2, T, 2) of views left out."""
    error, used = residuals(kept, rig), _used(kept)
    covariance, left_out = judged
    lists = [
        [dropped_corners(corners, kept, error[device], (device, i), names[i]) for i in used]
        for device in range(len(DEVICES))
    ]
    return PlanarPair(
        rig.lenses[0],
        rig.lenses[1],
        rig.devices[1],
        covariance,
        rig.bend,
        kept.area,
        {names[i]: rig.boards[i] for i in used},
        _by_view(kept, error, {i: names[i] for i in used}),
        _by_view(kept, left_out, {i: names[i] for i in used}),
        {device: tuple(itertools.chain(*of)) for device, of in zip(DEVICES, lists, strict=True)},
        tuple(name for i, name in enumerate(names) if i not in used),
    )


def _by_view(kept: Corners, error: Array, names: Mapping[int, str]) -> dict[str, dict[str, Array]]:
    """Residuals (N, 2) [px] of the corners in use, per device and view."""
    return {
        name: {
            view: error[device, kept.views[i]][kept.use[device, kept.views[i]]]
            for i, view in names.items()
        }
        for device, name in enumerate(DEVICES)
    }


def _used(corners: Corners) -> list[int]:
    """The views of which both devices have corners in use."""
    return [i for i, view in enumerate(corners.views) if corners.use[:, view].any(axis=1).all()]


def _check_used(kept: Corners) -> None:
    if len(_used(kept)) < MIN_VIEWS:
        raise NotEnoughData(
            f"poses: only {len(_used(kept))} fit two lenses and one board; at least {MIN_VIEWS} are needed. "
            "Check the number of squares, and that neither device moved or zoomed between them"
        )


def _check(views: Sequence[PairView], projector_size: tuple[int, int]) -> None:
    check_count(views, 6)
    for view in views:
        lit = np.asarray(np.isfinite(view.projector_px).all(axis=1), np.bool_)
        if not determines_pose(view.points[lit]):
            raise NotEnoughData(
                f"{view.name}: the projector lights {int(lit.sum())} of {len(lit)} corners; at least "
                f"{MIN_CORNERS} over an area are needed. Let the picture of "
                f"{projector_size[0]}x{projector_size[1]} cover the board"
            )
