"""Intrinsics of a camera from photographs of a flat board, with what they are worth.

Zhang 2000 (doi:10.1109/34.888718) with our own start, so that fisheyes beyond 90 degrees off the
axis need no help; the board may be bent, gross corners are found, and views are left out in turn to
see how well the lens predicts pictures that it was not fitted to.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, NotEnoughData, ShapeError
from procam.estimate.boards.adjustment import BoardRig, Corners, gather_corners, residuals
from procam.estimate.boards.robust_fit import (
    EYE,
    FEWEST_CORNERS,
    BoardFit,
    DroppedCorner,
    check_focal,
    check_tilts,
    determines_pose,
    dropped_corners,
    fit_poses,
)
from procam.estimate.boards.start import pose_of_board, start_camera
from procam.maths.geometry.lenses import Lens, LensKind, unproject
from procam.maths.geometry.pose import Pose

Array = NDArray[np.float64]
FEWEST_VIEWS = 3
FOLDS, FEWEST_TO_LEAVE_OUT = 5, 6
GRID = 8
NAMES = {
    "brown": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    "kannala-brandt": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}


@dataclass(frozen=True, slots=True)
class BoardView:
    """What one photograph shows of the board.

    Attributes
    ----------
    name : of the photograph.
    points : (N, 3) the corners on the flat board, z = 0 [m].
    pixels : (N, 2) where they are seen [px].
    """

    name: str
    points: Array
    pixels: Array


@dataclass(frozen=True, slots=True)
class CameraFit:
    """A solved camera.

    Attributes
    ----------
    size : (width, height) of the pictures [px].
    lens : the intrinsics.
    covariance : (P, P) of fx, fy, cx, cy [px] and the distortion terms [-], in this order.
    bend : (3,) how the board sags [m], and `bend_covariance` (3, 3); see `board_bundle.Rig`.
    area : (2, 2) lowest and highest x, y of the board's corners [m]; `bend` refers to it.
    boards : camera_from_board per view that was fitted.
    residual_px : (N, 2) predicted minus seen per view, of the corners that were fitted.
    held_out_px : the same for each view while it was left out and only its pose was fitted; empty
        when there are too few views to leave any out.
    dropped : gross corners. dropped_views : views that lost so many that nothing of them was used.
    coverage : share of the picture, in 8 x 8 fields, in which corners were fitted [-].
    reach_deg : largest angle off the axis at which a corner was fitted.
    """

    size: tuple[int, int]
    lens: Lens
    covariance: Array
    bend: Array
    bend_covariance: Array
    area: Array
    boards: dict[str, Pose]
    residual_px: dict[str, Array]
    held_out_px: dict[str, Array]
    dropped: tuple[DroppedCorner, ...]
    dropped_views: tuple[str, ...]
    coverage: float
    reach_deg: float

    @property
    def sigma(self) -> dict[str, float]:
        """Standard error of each intrinsic parameter, by name [px, -]."""
        names = NAMES[self.lens.kind]
        return dict(zip(names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def fit_camera(views: Sequence[BoardView], size: tuple[int, int], kind: LensKind) -> CameraFit:
    """Solve a camera of `size` (width, height) [px] from three or more views of one flat board.

    Raises
    ------
    NotEnoughData
        Too few views, or all of boards that lie parallel: they leave the focal length open.
    """
    _check_views(views, size)
    corners = gather_corners([v.points for v in views], [v.pixels[None] for v in views])
    fit = BoardFit((tuple(range(len(NAMES[kind]))),), bend=True)
    rig = fit.robustly(corners, start_camera(kind, size, corners))
    check_tilts(rig)
    kept, rig = fit.without_gross(corners, rig)
    used = [i for i, view in enumerate(kept.views) if kept.use[0, view].any()]
    names = [v.name for v in views]
    if len(used) < FEWEST_VIEWS:
        raise NotEnoughData(
            f"views: got {len(used)} that fit one lens and one board, expected at least "
            f"{FEWEST_VIEWS}; is the number of squares right, and was the zoom left alone?"
        )
    covariance = fit.bundle(kept, rig).covariance(rig)
    lenses = len(covariance) - len(rig.bend)
    check_focal(rig.lenses[0], covariance)
    error = residuals(kept, rig)[0]
    seen = kept.pixels[0][kept.use[0]]
    return CameraFit(
        size,
        rig.lenses[0],
        covariance[:lenses, :lenses],
        rig.bend,
        covariance[lenses:, lenses:],
        kept.area,
        {names[i]: rig.boards[i] for i in used},
        {names[i]: _of_view(kept, error, i) for i in used},
        {names[i]: left for i, left in _leave_out(fit, kept, rig, used).items()},
        tuple(d for i in used for d in dropped_corners(corners, kept, error, (0, i), names[i])),
        tuple(name for i, name in enumerate(names) if i not in used),
        _coverage(seen, size),
        float(np.degrees(np.arccos(unproject(seen, rig.lenses[0])[:, 2].min()))),
    )


def view_residuals(fit: CameraFit, views: Sequence[BoardView]) -> dict[str, Array]:
    """Predicted minus seen pixel (N, 2) in views that were not fitted; only their poses are.

    All corners count, gross ones too.
    """
    boards = tuple(pose_of_board(v.points, unproject(v.pixels, fit.lens)) for v in views)
    corners = gather_corners([v.points for v in views], [v.pixels[None] for v in views], fit.area)
    rig = fit_poses(corners, BoardRig((fit.lens,), (EYE,), boards, fit.bend))
    error = residuals(corners, rig)[0]
    return {view.name: _of_view(corners, error, i) for i, view in enumerate(views)}


def rms(residual: Mapping[str, Array]) -> float:
    """Root mean square length of residuals (N, 2) of all views [px]."""
    return float(np.sqrt(np.mean(np.sum(np.concatenate([*residual.values()]) ** 2, axis=1))))


def _leave_out(fit: BoardFit, corners: Corners, rig: BoardRig, used: list[int]) -> dict[int, Array]:
    """Residuals (N, 2) of each view under a lens that was fitted without it."""
    left_out: dict[int, Array] = {}
    if len(used) < FEWEST_TO_LEAVE_OUT:
        return left_out
    for fold in range(FOLDS):
        test = used[fold::FOLDS]
        train = corners.only([i for i in used if i not in test])
        fitted, _ = fit.bundle(train, rig).solve(rig)
        judged = corners.only(test)
        error = residuals(judged, fit_poses(judged, fitted))[0]
        left_out |= {i: _of_view(judged, error, i) for i in test}
    return dict(sorted(left_out.items()))


def _of_view(corners: Corners, error: Array, view: int) -> Array:
    part = corners.views[view]
    return error[part][corners.use[0, part]]


def _coverage(pixels: Array, size: tuple[int, int]) -> float:
    fields = np.clip((pixels + 0.5) / np.array(size) * GRID, 0, GRID - 1).astype(int)
    return len(np.unique(fields, axis=0)) / GRID**2


def _check_views(views: Sequence[BoardView], size: tuple[int, int]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise NotEnoughData(
            f"views: got {len(views)} of the board, expected at least {FEWEST_VIEWS} and better 15; "
            "photograph it more often, tilted to all sides"
        )
    if len({v.name for v in views}) < len(views):
        raise InputError("views: got the same name twice, expected a name of its own for each")
    for view in views:
        if view.points.shape != (len(view.points), 3):
            raise ShapeError(f"{view.name}: points", view.points.shape, "(N, 3)")
        if view.pixels.shape != (len(view.points), 2):
            raise ShapeError(f"{view.name}: pixels", view.pixels.shape, "(N, 2) like its points")
        inside = (view.pixels > -1) & (view.pixels < size)
        if not inside.all():
            raise InputError(
                f"{view.name}: got corners outside the picture or NaN, expected all within "
                f"{size[0]}x{size[1]}; was the picture cropped or scaled after the corners were found?"
            )
        if not determines_pose(view.points):
            raise NotEnoughData(
                f"{view.name}: got {len(view.points)} corners or all along a line, expected at least "
                f"{FEWEST_CORNERS} over an area; leave this view out"
            )
