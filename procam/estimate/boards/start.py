"""Where to start: a focal length by a scan, and board poses from viewing rays.

Nothing here divides by the z of a ray, so boards seen at 90 degrees off the axis and beyond are
like any other.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procam.estimate.boards.adjustment import BoardAdjustment, BoardRig, Corners, residuals, spreads
from procam.maths.geometry.lenses import Lens, LensKind, unproject
from procam.maths.geometry.pose import Pose

Array = NDArray[np.float64]
FOCALS = 28
CANDIDATES = 4
SCANNED_VIEWS = 12
FIRST_STEPS = 30
WEIGHINGS = 8
UNLIKELY, UNLIKELY_PX = 10.0, 5.0
# half fields of view to try
WIDEST, WIDEST_PINHOLE, NARROWEST = np.radians([175.0, 75.0, 3.0])
COEFFICIENTS = {"brown": 5, "kannala-brandt": 4}


def pose_of_board(points: Array, rays: Array) -> Pose:
    """Pose of a flat board from rays (N, 3) to its points (N, 3), z = 0 [m].

    rays ~ H (x, y, 1) with H = (r1, r2, t) up to scale: the homography of Zhang 2000
    (doi:10.1109/34.888718) on rays instead of pixels. Gross corners are weighed down by the size
    of their miss.
    """
    middle, size = points[:, :2].mean(axis=0), float(np.ptp(points[:, :2]))
    flat = np.c_[(points[:, :2] - middle) / size, np.ones(len(points))]
    weight = np.ones(len(points))
    for _ in range(WEIGHINGS):
        matrix = ray_homography(flat, rays, weight)
        ahead = flat @ matrix.T
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
        miss = np.linalg.norm(ahead - rays, axis=1)
        weight = np.maximum(miss, 0.1 * np.median(miss) + 1e-9) ** -0.5  # sum of lengths
    scale = np.linalg.norm(matrix[:, :2], axis=0).mean()
    left, _, right = np.linalg.svd(matrix[:, :2], full_matrices=False)
    first, second = (left @ right).T
    rotation = np.stack([first, second, np.cross(first, second)], axis=1)
    translation = matrix[:, 2] / scale * size
    return Pose(rotation, translation - rotation[:, :2] @ middle)


def ray_homography(flat: Array, rays: Array, weight: Array) -> Array:
    """H (3, 3) with rays ~ H flat, from four or more rays (N, 3) to places (x, y, 1) (N, 3) of a plane.

    Least squares of rays x (H flat) = 0, weighed by `weight` (N,), with the rays ahead, not behind.
    """
    x, y, z = rays.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])  # (3, 3, N)
    rows = np.einsum("ijn,nk,n->nijk", cross, flat, weight).reshape(-1, 9)
    matrix = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 3)
    return matrix * np.sign(np.sum(weight * np.sum(rays * (flat @ matrix.T), axis=1)))


def start_camera(kind: LensKind, size: tuple[int, int], corners: Corners) -> BoardRig:
    """A camera near the truth, from a scan over focal lengths with an undistorted lens.

    The best few are refined with their first distortion term free, and the best of those is kept.
    """
    picked = np.unique(np.linspace(0, len(corners.views) - 1, SCANNED_VIEWS).round().astype(int))
    some = corners.only(picked.tolist())
    rigs = [_with_poses(_plain_lens(kind, size, f), corners) for f in _focals(kind, size)]
    rigs.sort(key=lambda rig: _score(some, rig))
    tried = [_first_steps(some, rig) for rig in rigs[:CANDIDATES]]
    best = min(tried, key=lambda rig: _score(some, rig))
    return better_poses(corners, _with_poses(best.lenses[0], corners))


def better_poses(corners: Corners, rig: BoardRig) -> BoardRig:
    """`rig` with the board poses that its lens's rays tell, where those miss by less."""
    fresh = BoardRig(rig.lenses, rig.devices, _with_poses(rig.lenses[0], corners).boards, rig.bend)
    old, new = _medians(corners, rig), _medians(corners, fresh)
    pairs = zip(rig.boards, fresh.boards, old > new, strict=True)
    return replace(rig, boards=tuple(b if better else a for a, b, better in pairs))


def likely(corners: Corners, rig: BoardRig) -> Corners:
    """The corners of views that `rig` fits about as well as most, and that lie before the camera.

    A board whose pose is quite wrong would hold up the fit of all others.
    """
    medians = _medians(corners, rig)
    limit = max(UNLIKELY * float(np.median(medians)), UNLIKELY_PX)
    good = corners.only(np.flatnonzero(medians <= limit).tolist())
    return replace(good, use=good.use & np.isfinite(residuals(corners, rig)).all(axis=2))


def _focals(kind: LensKind, size: tuple[int, int]) -> Array:
    """Focal lengths [px] that put the picture's corner at angles from 3 degrees to the widest."""
    half = float(np.hypot(*size)) / 2
    if kind == "brown":
        return half / np.tan(np.geomspace(WIDEST_PINHOLE, NARROWEST, FOCALS))
    return half / np.geomspace(WIDEST, NARROWEST, FOCALS)


def _plain_lens(kind: LensKind, size: tuple[int, int], focal: float) -> Lens:
    centre = (np.array(size, float) - 1) / 2
    return Lens(kind, np.full(2, focal), centre, np.zeros(COEFFICIENTS[kind]))


def _with_poses(lens: Lens, corners: Corners) -> BoardRig:
    rays = unproject(corners.pixels[0], lens)
    boards = []
    for view in corners.views:
        use = corners.use[0, view]
        boards.append(pose_of_board(corners.points[view][use], rays[view][use]))
    return BoardRig((lens,), (Pose(np.eye(3), np.zeros(3)),), tuple(boards), np.zeros(3))


def _medians(corners: Corners, rig: BoardRig) -> Array:
    """Median miss (V,) of the corners of each view in the first device [px]; inf without any."""
    miss = np.linalg.norm(residuals(corners, rig)[0], axis=1)
    miss = np.where(np.isfinite(miss), miss, np.inf)
    uses = ((view, corners.use[0, view]) for view in corners.views)
    return np.array([np.median(miss[view][use]) if use.any() else np.inf for view, use in uses])


def _score(corners: Corners, rig: BoardRig) -> float:
    """How well a rig fits most views [px]."""
    medians = _medians(corners, rig)
    used = [corners.use[0, view].any() for view in corners.views]
    return float(np.mean(np.minimum(medians[used], 1e6)))


def _first_steps(corners: Corners, rig: BoardRig) -> BoardRig:
    """A few steps with focal lengths and the first distortion term free."""
    seen = likely(corners, rig)
    sigma = spreads(seen, residuals(seen, rig))
    return BoardAdjustment(seen, ((0, 1, 4),), sigma, robust=True).solve(rig, FIRST_STEPS)[0]
