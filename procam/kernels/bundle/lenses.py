"""Derivatives of lenses in NumPy, and the inverse of the fisheye.

A lens is its kind and its parameters (P,): focal x, y, centre x, y [px], then distortion [-], k1 k2
p1 p2 k3 of "brown" (Brown 1966, ordered as OpenCV does) or k1..k4 of "kannala-brandt" (Kannala &
Brandt 2006, doi:10.1109/TPAMI.2006.153).
"""

import numpy as np

from procam.arrays import Array

KNOTS = 2048  # of the table that Newton's method starts from
NEWTON_STEPS = 12


def project_slopes(points: Array, kind: str, lens: Array) -> tuple[Array, Array, Array]:
    """Pixels (N, 2) of points (N, 3), and their slopes by the point (N, 2, 3) and the lens (N, 2, P)."""
    derive = _derive_brown if kind == "brown" else _derive_fisheye
    focal, centre, distortion = lens[:2], lens[2:4], lens[4:]
    plane, plane_by_point, plane_by_k = derive(points, distortion)
    by_lens = np.zeros((len(points), 2, len(lens)))
    by_lens[:, (0, 1), (0, 1)] = plane
    by_lens[:, (0, 1), (2, 3)] = 1.0
    by_lens[:, :, 4:] = plane_by_k * focal[:, None]
    return plane * focal + centre, plane_by_point * focal[:, None], by_lens


def ray_slopes(ray: Array, kind: str, lens: Array) -> Array:
    """Slopes (N, 3, P) by its lens of the unit ray (N, 3) of a pixel.

    The ray moves so that its pixel stays: by the inverse of the projection's derivatives.
    """
    across, down = _tangents(ray)
    _, by_point, by_lens = project_slopes(ray, kind, lens)
    moved = np.stack(
        [np.einsum("nij,nj->ni", by_point, across), np.einsum("nij,nj->ni", by_point, down)],
        axis=-1,
    )
    steps = -np.linalg.solve(moved, by_lens)  # (N, 2, P) along the two tangents
    return across[..., None] * steps[:, :1] + down[..., None] * steps[:, 1:]


def fisheye_radius(theta: Array, k: Array) -> Array:
    """Distance (...) from the centre over the focal length at angles (...) [rad] off the axis."""
    t2 = theta * theta
    return theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))


def fisheye_angle(radius: Array, k: Array) -> Array:
    """Inverse of `fisheye_radius`: start from a table, then Newton's method."""
    table = np.linspace(0, np.pi, KNOTS)
    reach = fisheye_radius(table, k)
    rising = int(np.argmax(np.diff(reach, append=-np.inf) <= 0)) + 1  # beyond it the lens folds
    theta = np.interp(radius, reach[:rising], table[:rising])
    for _ in range(NEWTON_STEPS):
        t2 = theta * theta
        slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
        step = (fisheye_radius(theta, k) - radius) / slope
        theta = theta - step
        if np.nanmax(np.abs(step), initial=0.0) < 1e-12:  # quadratic: the error is far below
            break
    return theta


def fisheye_rays(pixels: Array, lens: Array) -> Array:
    """See `procam.kernels.fisheye_rays`."""
    plane = (pixels - lens[2:4]) / lens[:2]
    radius = np.hypot(plane[..., 0], plane[..., 1])
    theta = fisheye_angle(radius, lens[4:])
    safe = np.where(radius > 0, radius, 1.0)
    sine = np.where(radius > 0, np.sin(theta) / safe, 1.0)
    return np.stack([plane[..., 0] * sine, plane[..., 1] * sine, np.cos(theta)], axis=-1)


def _derive_brown(points: Array, k: Array) -> tuple[Array, Array, Array]:
    """Plane coordinates (N, 2) and their derivatives by point (N, 2, 3) and by k (N, 2, 5)."""
    k1, k2, p1, p2, k3 = k
    depth = np.where(points[:, 2] > 0, points[:, 2], np.nan)
    x, y = points[:, 0] / depth, points[:, 1] / depth
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d(radial)/d(r^2) times 2
    jxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    jxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
    jyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    by_x = np.stack([jxx, jxy], axis=1) / depth[:, None]
    by_y = np.stack([jxy, jyy], axis=1) / depth[:, None]
    by_point = np.stack([by_x, by_y, -x[:, None] * by_x - y[:, None] * by_y], axis=2)

    tangential = np.stack([2 * x * y, r2 + 2 * x * x, r2 + 2 * y * y], axis=1)
    line = np.stack([x, y], axis=1)
    plane = line * radial[:, None] + p1 * tangential[:, [0, 2]] + p2 * tangential[:, [1, 0]]
    terms = [line * r2[:, None], line * r2[:, None] ** 2]
    terms += [tangential[:, [0, 2]], tangential[:, [1, 0]], line * r2[:, None] ** 3]
    return plane, by_point, np.stack(terms, axis=2)


def _derive_fisheye(points: Array, k: Array) -> tuple[Array, Array, Array]:
    """Plane coordinates (N, 2) and their derivatives by point (N, 2, 3) and by k (N, 2, 4)."""
    x, y, z = points.T
    across = np.hypot(x, y)
    theta = np.arctan2(across, z)
    t2 = theta * theta
    radius = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
    slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])))
    square = across**2 + z * z
    on_axis = across == 0
    scale = np.where(on_axis, 1 / z, radius / np.where(on_axis, 1.0, across))
    unit = points[:, :2] / np.where(on_axis, 1.0, across)[:, None]
    bend = slope * z / square - scale  # radial minus tangential stretch, 0 on the axis
    by_xy = scale[:, None, None] * np.eye(2) + bend[:, None, None] * (
        unit[:, :, None] * unit[:, None, :]
    )
    by_z = -points[:, :2] * (slope / square)[:, None]
    by_point = np.concatenate([by_xy, by_z[:, :, None]], axis=2)
    powers = theta[:, None] ** np.array([3, 5, 7, 9])
    return points[:, :2] * scale[:, None], by_point, unit[:, :, None] * powers[:, None, :]


def _tangents(ray: Array) -> tuple[Array, Array]:
    """Two unit vectors (N, 3) across unit rays (N, 3) (Duff et al. 2017, no branch but the sign)."""
    x, y, z = ray.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    across = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return across, np.stack([b, sign + y * y * a, -y], axis=1)
