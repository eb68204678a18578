"""Initial values: a focal length by a scan, and board poses from viewing rays.

Nothing here divides by the z of a ray, so a fisheye's boards at 90 degrees off the axis and beyond
need no special case.
"""

from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import BoardRig, Corners, residual_sigmas, residuals
from procam.maths.geometry.lenses import Lens, LensKind, unproject
from procam.maths.geometry.pose import Pose

FOCALS, SCANNED_VIEWS = 28, 12  # of the scan
CANDIDATES, REFINEMENT_STEPS = 4, 30  # of the best focal lengths
REWEIGHTINGS = 8
IMPLAUSIBLE, MIN_IMPLAUSIBLE_PX = 10.0, 5.0  # median residual of a view, over that of all views
# half fields of view to try [rad]
WIDEST, WIDEST_PINHOLE, NARROWEST = np.radians([175.0, 75.0, 3.0])
NO_POSE = Pose(np.eye(3), np.array([0.0, 0.0, 1.0]))
COEFFICIENTS = {"brown": 5, "kannala-brandt": 4}


def pose_from_rays(points: Array, rays: Array) -> Pose:
    """Pose of a flat board from rays (N, 3) to its points (N, 3), z = 0 [m].

    rays ~ H (x, y, 1) with H = (r1, r2, t) up to scale: the homography of Zhang 2000
    (doi:10.1109/34.888718) on rays instead of pixels, with weights that reduce the influence of
    outliers.
    """
    middle, size = points[:, :2].mean(axis=0), float(np.ptp(points[:, :2]))
    flat = np.c_[(points[:, :2] - middle) / size, np.ones(len(points))]
    weight = np.ones(len(points))
    for _ in range(REWEIGHTINGS):
        matrix = homography_from_rays(flat, rays, weight)
        ahead = flat @ matrix.T
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
        miss = np.linalg.norm(ahead - rays, axis=1)
        weight = (
            np.maximum(miss, 0.1 * np.median(miss) + 1e-9) ** -0.5
        )  # minimises the sum of lengths
    scale = np.linalg.norm(matrix[:, :2], axis=0).mean()
    left, _, right = np.linalg.svd(matrix[:, :2], full_matrices=False)
    first, second = (left @ right).T
    rotation = np.stack([first, second, np.cross(first, second)], axis=1)
    translation = matrix[:, 2] / scale * size
    return Pose(rotation, translation - rotation[:, :2] @ middle)


def homography_from_rays(flat: Array, rays: Array, weight: Array) -> Array:
    """H (3, 3) with rays ~ H flat, from four or more rays (N, 3) to points (x, y, 1) (N, 3) of a plane.

    Least squares of rays x (H flat) = 0 with weights (N,); the sign puts the points before the device.
    """
    x, y, z = rays.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])  # (3, 3, N)
    rows = np.einsum("ijn,nk,n->nijk", cross, flat, weight).reshape(-1, 9)
    matrix = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    return matrix * np.sign(np.sum(weight * np.sum(rays * (flat @ matrix.T), axis=1)))


def start_camera(kind: LensKind, size: tuple[int, int], corners: Corners) -> BoardRig:
    """Initial camera and board poses, from a scan over focal lengths of an undistorted lens.

    The best few candidates are refined with their first distortion term free.
    """
    picked = np.unique(np.linspace(0, len(corners.views) - 1, SCANNED_VIEWS).round().astype(int))
    some = corners.only(picked.tolist())
    rigs = [_with_poses(_plain_lens(kind, size, f), some) for f in _focals(kind, size)]
    rigs.sort(key=lambda rig: _mean_residual(some, rig))
    tried = [_refined(some, rig) for rig in rigs[:CANDIDATES]]
    best = min(tried, key=lambda rig: _mean_residual(some, rig))
    return reestimate_poses(corners, _with_poses(best.lenses[0], corners))


def reestimate_poses(corners: Corners, rig: BoardRig) -> BoardRig:
    """`rig` with each board pose recomputed from the lens's rays, where that lowers the residual."""
    fresh = BoardRig(rig.lenses, rig.devices, _with_poses(rig.lenses[0], corners).boards, rig.bend)
    old, new = _medians(corners, rig), _medians(corners, fresh)
    pairs = zip(rig.boards, fresh.boards, old > new, strict=True)
    return replace(rig, boards=tuple(b if better else a for a, b, better in pairs))


def plausible_corners(corners: Corners, rig: BoardRig) -> Corners:
    """The corners of views that `rig` fits about as well as most, and that lie before the camera.

    A board with a grossly wrong pose would slow down the fit of all others.
    """
    medians = _medians(corners, rig)
    limit = max(IMPLAUSIBLE * float(np.median(medians)), MIN_IMPLAUSIBLE_PX)
    good = corners.only(np.flatnonzero(medians <= limit).tolist())
    return replace(good, use=good.use & np.isfinite(residuals(corners, rig)).all(axis=2))


def _focals(kind: LensKind, size: tuple[int, int]) -> Array:
    """Focal lengths [px] that put the picture's corner at angles from the widest to 3 degrees."""
    half = float(np.hypot(*size)) / 2
    if kind == "brown":
        return half / np.tan(np.geomspace(WIDEST_PINHOLE, NARROWEST, FOCALS))
    return half / np.geomspace(WIDEST, NARROWEST, FOCALS)


def _plain_lens(kind: LensKind, size: tuple[int, int], focal: float) -> Lens:
    centre = (np.array(size, float) - 1) / 2
    return Lens(kind, np.full(2, focal), centre, np.zeros(COEFFICIENTS[kind]))


def _with_poses(lens: Lens, corners: Corners) -> BoardRig:
    """A pose of the board for each view; that of a view without corners in use has no meaning."""
    rays = unproject(corners.pixels[0], lens)
    boards = []
    for view in corners.views:
        use = corners.use[0, view]
        points, seen = corners.points[view][use], rays[view][use]
        boards.append(pose_from_rays(points, seen) if use.any() else NO_POSE)
    return BoardRig((lens,), (Pose(np.eye(3), np.zeros(3)),), tuple(boards), np.zeros(3))


def _medians(corners: Corners, rig: BoardRig) -> Array:
    """Median residual (V,) of each view in the first device [px]; inf without observations."""
    miss = np.linalg.norm(residuals(corners, rig)[0], axis=1)
    miss = np.where(np.isfinite(miss), miss, np.inf)
    uses = ((view, corners.use[0, view]) for view in corners.views)
    return np.array([np.median(miss[view][use]) if use.any() else np.inf for view, use in uses])


def _mean_residual(corners: Corners, rig: BoardRig) -> float:
    """Mean over the views in use of the median residual [px]."""
    medians = _medians(corners, rig)
    used = [corners.use[0, view].any() for view in corners.views]
    return float(np.mean(np.minimum(medians[used], 1e6)))


def _refined(corners: Corners, rig: BoardRig) -> BoardRig:
    """Refine focal lengths and the first distortion term in a few steps."""
    seen = plausible_corners(corners, rig)
    sigma = residual_sigmas(seen, residuals(seen, rig))
    return BoardAdjustment(seen, ((0, 1, 4),), sigma, robust=True).solve(rig, REFINEMENT_STEPS)[0]
