"""From a rough rig to the best one: robust first, then without the gross corners."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.errors import DidNotConverge, NotEnoughData
from procam.estimate.boards.adjustment import BoardAdjustment, BoardRig, Corners, residuals, spreads
from procam.estimate.boards.start import better_poses, likely
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose

Array = NDArray[np.float64]
EYE = Pose(np.eye(3), np.zeros(3))
FEWEST_CORNERS = 8
LEAST_WIDTH = 0.05  # of a cloud of corners, over its length
ROUNDS = 3
GROSS_SIGMAS, SMALLEST_GROSS_PX = 6.0, 0.1
LEFT_SHARE = 0.5  # of a view's corners must fit, or none is used
LEAST_TILT_DEG = 5.0
WORST_FOCAL_SIGMA = 0.02


@dataclass(frozen=True, slots=True)
class DroppedCorner:
    """A gross corner: number `index` of photograph `view`, seen at `pixel` (x, y), `miss_px` off."""

    view: str
    index: int
    pixel: tuple[float, float]
    miss_px: float


@dataclass(frozen=True, slots=True)
class BoardFit:
    """What to solve for: `free` lens parameters per device, and the board's `bend`."""

    free: tuple[tuple[int, ...], ...]
    bend: bool = False

    def bundle(self, corners: Corners, rig: BoardRig, robust: bool = False) -> BoardAdjustment:
        """The least-squares problem around `rig`."""
        sigma = spreads(corners, residuals(corners, rig))
        return BoardAdjustment(corners, self.free, sigma, self.bend, robust)

    def robustly(self, corners: Corners, rig: BoardRig) -> BoardRig:
        """The best rig with gross corners among the others; poses are looked for anew in between."""
        for _ in range(ROUNDS):
            rig, _ = self.bundle(likely(corners, rig), rig, robust=True).solve(rig)
            rig = better_poses(corners, rig)
        return rig

    def without_gross(self, corners: Corners, rig: BoardRig) -> tuple[Corners, BoardRig]:
        """Least squares of the corners that are not gross; a later round may take some back.

        Raises
        ------
        DidNotConverge
            The fit found no end.
        """
        kept, done = corners, False
        for _ in range(ROUNDS):
            # a view that was left out gets its chance with the lens that the others have made
            rig = fit_poses(likely(corners, rig), rig, robust=True)
            kept = _near(corners, kept, rig)
            if not kept.use.any():
                return kept, rig
            rig, done = self.bundle(kept, rig).solve(rig)
        if not done:
            raise DidNotConverge(
                "lens: got no end of the fit, expected one within 200 steps; is the model right for it, "
                "and the number of squares?"
            )
        return kept, rig


def determines_pose(points: Array) -> bool:
    """Whether corners (N, 3) are enough for a pose: eight, and not along a line."""
    if len(points) < FEWEST_CORNERS:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > LEAST_WIDTH * spread[0])


def fit_poses(corners: Corners, rig: BoardRig, robust: bool = False) -> BoardRig:
    """Only the boards' poses, all else as it is."""
    free: tuple[tuple[int, ...], ...] = ((),) * len(rig.lenses)
    return BoardFit(free).bundle(corners, rig, robust).solve(rig)[0]


def dropped_corners(
    corners: Corners, kept: Corners, error: Array, where: tuple[int, int], name: str
) -> list[DroppedCorner]:
    """Corners that one device, in one view, `where`, sees but that are not `kept`; error (T, 2)."""
    device, view = where
    part = corners.views[view]
    gross = np.flatnonzero(corners.use[device, part] & ~kept.use[device, part])
    found = []
    for index in gross.tolist():
        x, y = corners.pixels[device, part][index].tolist()
        found.append(DroppedCorner(name, index, (x, y), float(np.linalg.norm(error[part][index]))))
    return found


def check_tilts(rig: BoardRig) -> None:
    """Parallel boards give the same two equations over and over (Zhang 2000, section 3.1)."""
    normals = np.array([b.rotation[:, 2] for b in rig.boards])
    spread = np.degrees(np.arccos(np.clip(np.abs(normals @ normals.T).min(), 0, 1)))
    if not spread >= LEAST_TILT_DEG:
        raise NotEnoughData(
            f"views: got boards that are all parallel within {spread:.1f} degrees, expected tilts of "
            "20 to 45 degrees to all sides: parallel ones leave the focal length open; tilt the "
            "board or the camera between photographs"
        )


def check_focal(lens: Lens, covariance: Array) -> None:
    """Refuse a lens whose focal lengths, first in `covariance`, are hardly known."""
    share = float((np.sqrt(np.diag(covariance)[:2]) / lens.focal).max())
    if not share <= WORST_FOCAL_SIGMA:
        raise NotEnoughData(
            f"views: got a focal length of {lens.focal[0]:.4g} px that is uncertain by "
            f"{share:.0%}, expected at most {WORST_FOCAL_SIGMA:.0%}; add views with the board "
            "tilted by 20 to 45 degrees and large in the picture"
        )


def _near(corners: Corners, kept: Corners, rig: BoardRig) -> Corners:
    """Corners that miss by no more than the crowd of those kept; of views with too few, none."""
    error = residuals(corners, rig)
    limit = np.maximum(GROSS_SIGMAS * spreads(kept, error), SMALLEST_GROSS_PX)
    near = corners.use & (np.linalg.norm(error, axis=2) <= limit[:, None])
    for view in corners.views:
        left, seen = near[:, view].sum(axis=1), corners.use[:, view].sum(axis=1)
        near[:, view] &= (left >= LEFT_SHARE * seen)[:, None]
        near[:, view] &= determines_pose(corners.points[view][near[0, view]])
    return replace(corners, use=near)
