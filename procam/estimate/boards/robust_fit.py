"""Board adjustment with outliers: a robust fit first, then least squares of the inliers."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array
from procam.errors import DidNotConverge, NotEnoughData
from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import BoardRig, Corners, residual_sigmas, residuals
from procam.estimate.boards.start import plausible_corners, reestimate_poses
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose

PINHOLE_TERMS = 4  # of `lens_parameters`, before the distortion
IDENTITY = Pose(np.eye(3), np.zeros(3))
MIN_VIEWS, MIN_CORNERS = 3, 8  # of a board; of a view
MIN_WIDTH = 0.05  # of the corners of a view, over their length
ROUNDS = 3  # of rejecting outliers and fitting the others
OUTLIER_SIGMAS, MIN_OUTLIER_PX = 6.0, 0.1
MIN_INLIERS = 0.5  # of a view's corners, or the whole view is rejected
MIN_TILT_DEG = 5.0  # between any two boards; below, the focal length is not determined
MAX_FOCAL_SIGMA = 0.02  # of the focal length


@dataclass(frozen=True, slots=True)
class DroppedCorner:
    """An outlier: corner `index` of photograph `view`, observed at `pixel` (x, y), `miss_px` off.

    `place_m` is its (x, y) on the board [m].
    """

    view: str
    index: int
    pixel: tuple[float, float]
    miss_px: float
    place_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class BoardFit:
    """The parameters to solve for: `free` lens parameters per device, and the board's `bend`."""

    free: tuple[tuple[int, ...], ...]
    bend: bool = False

    def adjustment(self, corners: Corners, rig: BoardRig, robust: bool = False) -> BoardAdjustment:
        """The least-squares problem near `rig`, with the noise that its residuals show."""
        sigma = residual_sigmas(corners, residuals(corners, rig))
        return BoardAdjustment(corners, self.free, sigma, self.bend, robust)

    def simplified(self, rig: BoardRig) -> BoardRig:
        """`rig` without the distortion and the bend that this fit does not solve for."""
        lenses = tuple(map(_without_others, rig.lenses, self.free))
        return replace(rig, lenses=lenses, bend=rig.bend if self.bend else np.zeros(3))

    def fit_robustly(self, corners: Corners, rig: BoardRig) -> BoardRig:
        """Fit corners with outliers among them; board poses are re-estimated between rounds."""
        for _ in range(ROUNDS):
            plausible = plausible_corners(corners, rig)
            rig, _ = self.adjustment(plausible, rig, robust=True).solve(rig)
            rig = reestimate_poses(corners, rig)
        return rig

    def fit_inliers(self, corners: Corners, rig: BoardRig) -> tuple[Corners, BoardRig]:
        """Least squares of the inliers, which every round chooses anew.

        Returns
        -------
        kept, rig : the corners with only the inliers in use, and the fit.

        Raises
        ------
        DidNotConverge
            The fit did not reach a minimum.
        """
        kept, converged = corners, False
        for _ in range(ROUNDS):
            # the better lens may explain a view that an earlier round rejected
            rig = fit_poses(plausible_corners(corners, rig), rig, robust=True)
            kept = _inliers(corners, kept, rig)
            if not kept.use.any():
                return kept, rig
            rig, converged = self.adjustment(kept, rig).solve(rig)
        if not converged:
            raise DidNotConverge(
                "lens: the fit did not settle within 200 steps; check that the lens model suits the lens "
                "and that the number of squares is right"
            )
        return kept, rig


def determines_pose(points: Array) -> bool:
    """Whether corners (N, 3) determine a pose: eight or more, and not along a line."""
    if len(points) < MIN_CORNERS:
        return False
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extent[1] > MIN_WIDTH * extent[0])


def check_count(views: Sequence[object], enough: int) -> None:
    """Refuse fewer than three views."""
    if len(views) < MIN_VIEWS:
        raise NotEnoughData(
            f"views: only {len(views)} of the board; at least {MIN_VIEWS} are needed, {enough} are better. "
            "Photograph it more often, tilted to all sides"
        )


def fit_poses(corners: Corners, rig: BoardRig, robust: bool = False) -> BoardRig:
    """Fit only the boards' poses; lenses, devices and bend stay."""
    free: tuple[tuple[int, ...], ...] = ((),) * len(rig.lenses)
    return BoardFit(free).adjustment(corners, rig, robust).solve(rig)[0]


def dropped_corners(
    corners: Corners, kept: Corners, error: Array, where: tuple[int, int], name: str
) -> list[DroppedCorner]:
    """Observations that are not `kept`, of one device in one view: `where`; error (T, 2) [px]."""
    device, view = where
    part = corners.views[view]
    outliers = np.flatnonzero(corners.use[device, part] & ~kept.use[device, part])
    found = []
    for index in outliers.tolist():
        x, y = corners.pixels[device, part][index].tolist()
        miss = float(np.linalg.norm(error[part][index]))
        u, v = corners.points[part][index, :2].tolist()
        found.append(DroppedCorner(name, index, (x, y), miss, (u, v)))
    return found


def check_tilts(rig: BoardRig) -> None:
    """Refuse parallel boards: they all give the same two equations (Zhang 2000, section 3.1)."""
    normals = np.array([b.rotation[:, 2] for b in rig.boards])
    widest = np.degrees(np.arccos(np.clip(np.abs(normals @ normals.T).min(), 0, 1)))
    if not widest >= MIN_TILT_DEG:
        raise NotEnoughData(
            f"views: all boards are parallel within {widest:.1f} degrees, which leaves the focal length "
            "open; tilt the board or the camera by 20 to 45 degrees to all sides between photographs"
        )


def check_focal(lens: Lens, covariance: Array) -> None:
    """Refuse a lens with uncertain focal lengths, the first two parameters of `covariance`."""
    share = float((np.sqrt(np.diag(covariance)[:2]) / lens.focal).max())
    if not share <= MAX_FOCAL_SIGMA:
        raise NotEnoughData(
            f"views: the focal length of {lens.focal[0]:.4g} px is uncertain by {share:.0%}, more than "
            f"{MAX_FOCAL_SIGMA:.0%}; add views with the board tilted by 20 to 45 degrees and large in "
            "the picture"
        )


def _without_others(lens: Lens, free: tuple[int, ...]) -> Lens:
    """A lens with zeros for the distortion terms that are not among `free`."""
    solved = np.isin(np.arange(len(lens.distortion)) + PINHOLE_TERMS, free)
    return replace(lens, distortion=np.where(solved, lens.distortion, 0.0))


def _inliers(corners: Corners, kept: Corners, rig: BoardRig) -> Corners:
    """Corners within the limit that the residuals of `kept` set; of views with too few, none."""
    error = residuals(corners, rig)
    limit = np.maximum(OUTLIER_SIGMAS * residual_sigmas(kept, error), MIN_OUTLIER_PX)
    near = corners.use & (np.linalg.norm(error, axis=2) <= limit[:, None])
    for view in corners.views:
        inliers, observed = near[:, view].sum(axis=1), corners.use[:, view].sum(axis=1)
        near[:, view] &= (inliers >= MIN_INLIERS * observed)[:, None]
        near[:, view] &= determines_pose(corners.points[view][near[0, view]])
    return replace(corners, use=near)
