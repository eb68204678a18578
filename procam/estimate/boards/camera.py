"""Intrinsics of a camera from photographs of a flat board, with their standard errors.

The method is that of Zhang 2000 (doi:10.1109/34.888718) with initial values that also suit fisheyes
beyond 90 degrees off the axis. The fit solves for the bend of the board and rejects outliers.
Cross-validation leaves views out in turn and measures how well the lens predicts them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array
from procam.errors import InputError, NotEnoughData, ProcamError
from procam.estimate.boards.corners import BoardRig, Corners, residuals, stack_corners
from procam.estimate.boards.left_out import clearly_better, held_out_residuals, jackknife_covariance
from procam.estimate.boards.robust_fit import (
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
from procam.maths.geometry.lenses import Lens, LensKind, unproject
from procam.maths.geometry.pose import Pose

FOLDS, MIN_VIEWS_TO_HOLD_OUT = 5, 6  # of the cross-validation
GRID = 8  # cells per side of the coverage figure
NAMES: dict[LensKind, tuple[str, ...]] = {
    "brown": ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    "kannala-brandt": ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"),
}


@dataclass(frozen=True, slots=True)
class BoardView:
    """The corners that one photograph shows.

    Attributes
    ----------
    name : of the photograph.
    points : (N, 3) on the flat board, z = 0 [m].
    pixels : (N, 2) in the photograph [px].
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
    covariance : (P, P) of fx, fy, cx, cy [px] and the distortion terms [-], in this order; errors of
        the model are in it.
    bend : (3,) as in `BoardRig` [m].
    area : (2, 2) lowest and highest x, y of the board's corners [m]; `bend` refers to it.
    boards : camera_from_board per fitted view.
    residual_px : (N, 2) predicted minus observed, per fitted view.
    held_out_px : the same for each view under a lens fitted without it, with only its pose fitted;
        empty when there are too few views.
    dropped : outliers. dropped_views : views rejected as a whole.
    coverage : share of the picture's 8 x 8 cells that hold fitted corners [-].
    reach_deg : largest angle off the axis of a fitted corner.
    """

    size: tuple[int, int]
    lens: Lens
    covariance: Array
    bend: Array
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
        Too few views, or parallel boards, which leave the focal length open.
    DidNotConverge
        The fit did not reach a minimum.
    """
    _check_views(views, size)
    corners = stack_corners([v.points for v in views], [v.pixels[None] for v in views])
    fit = BoardFit((tuple(range(len(NAMES[kind]))),), bend=True)
    rig = fit.fit_robustly(corners, start_camera(kind, size, corners))
    check_tilts(rig)
    kept, rig = fit.fit_inliers(corners, rig)
    used = [i for i, view in enumerate(kept.views) if kept.use[0, view].any()]
    names = [v.name for v in views]
    if len(used) < MIN_VIEWS:
        raise NotEnoughData(
            f"views: only {len(used)} fit one lens and one board; at least {MIN_VIEWS} are needed. Check "
            "the number of squares, and that the zoom did not change"
        )
    adjustment = fit.adjustment(kept, rig)
    check_focal(rig.lenses[0], adjustment.covariance(rig))
    covariance = jackknife_covariance(adjustment, rig)
    lenses = len(covariance) - len(rig.bend)
    error = residuals(kept, rig)[0]
    seen = kept.pixels[0][kept.use[0]]
    return CameraFit(
        size,
        rig.lenses[0],
        covariance[:lenses, :lenses],
        rig.bend,
        kept.area,
        {names[i]: rig.boards[i] for i in used},
        {names[i]: _of_view(kept, error, i) for i in used},
        _held_out(fit, kept, rig, {i: names[i] for i in used}),
        tuple(d for i in used for d in dropped_corners(corners, kept, error, (0, i), names[i])),
        tuple(name for i, name in enumerate(names) if i not in used),
        _coverage(seen, size),
        float(np.degrees(np.arccos(unproject(seen, rig.lenses[0])[:, 2].min()))),
    )


def better_fit(fit: CameraFit, views: Sequence[BoardView]) -> CameraFit | None:
    """The fit of another kind of lens, if it predicts views left out of it clearly better."""
    for kind in NAMES:
        try:
            other = None if kind == fit.lens.kind else fit_camera(views, fit.size, kind)
        except ProcamError:  # a kind that cannot be fitted is not better
            continue
        if other and clearly_better(other.held_out_px, fit.held_out_px):
            return other
    return None


def rms(residual: Mapping[str, Array]) -> float:
    """Root mean square length of residuals (N, 2) of all views [px]."""
    return float(np.sqrt(np.mean(np.sum(np.concatenate([*residual.values()]) ** 2, axis=1))))


def _held_out(
    fit: BoardFit, corners: Corners, rig: BoardRig, used: Mapping[int, str]
) -> dict[str, Array]:
    if len(used) < MIN_VIEWS_TO_HOLD_OUT:
        return {}
    error = held_out_residuals(fit, corners, rig, FOLDS)[0]
    return {name: _of_view(corners, error, i) for i, name in used.items()}


def _of_view(corners: Corners, error: Array, view: int) -> Array:
    part = corners.views[view]
    return error[part][corners.use[0, part]]


def _coverage(pixels: Array, size: tuple[int, int]) -> float:
    cells = np.clip((pixels + 0.5) / np.array(size) * GRID, 0, GRID - 1).astype(int)
    return len(np.unique(cells, axis=0)) / GRID**2


def _check_views(views: Sequence[BoardView], size: tuple[int, int]) -> None:
    check_count(views, 15)
    if len({v.name for v in views}) < len(views):
        raise InputError("views: two have the same name; give each a name of its own")
    for view in views:
        _check_view(view, size)


def _check_view(view: BoardView, size: tuple[int, int]) -> None:
    if not ((view.pixels > -1) & (view.pixels < size)).all():
        raise InputError(
            f"{view.name}: some corners are NaN or outside the picture of {size[0]}x{size[1]}; find the "
            "corners again if the picture was cropped or scaled since"
        )
    if not determines_pose(view.points):
        raise NotEnoughData(
            f"{view.name}: {len(view.points)} corners do not determine the board's pose; it needs at "
            f"least {MIN_CORNERS} over an area. Leave this view out"
        )
