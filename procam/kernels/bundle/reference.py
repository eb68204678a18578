"""The bundle adjustment as equations in NumPy: camera ray -> round screen -> projector pixel.

What runs without the library, and what the kernel of `procam.kernels.bundle` is tested against.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from procam.kernels.bundle.lenses import project_slopes, ray_slopes

Array = NDArray[np.float64]
STEPS = 3  # from near the screen onto it
CHUNK = 4096  # observations at a time: what they need stays in the cache


class Device(NamedTuple):
    """A placed camera or projector: x_device = rotation @ x_dome + translation.

    rotation (3, 3), translation (3,) [m]; kind and lens (P,) as in `reference_lenses`; pupil (2,):
    rays off the axis by theta start pupil[0] theta^2 + pupil[1] theta^4 [m] ahead on it.
    """

    rotation: Array
    translation: Array
    kind: str
    lens: Array
    pupil: Array


class Sight(NamedTuple):
    """What a camera sees of a projector: both, and the screen's radius [m] and bumps (K,)."""

    camera: Device
    projector: Device
    radius_m: float
    bumps: Array


class Relief(NamedTuple):
    """A screen's harmonics where rays meet its sphere: what is needed of it as the rays move a bit.

    start (N, 3): the unit directions; values (N, K) and slopes (N, K, 3) of the harmonics there.
    """

    start: Array
    values: Array
    slopes: Array

    def some(self, which: slice) -> "Relief":
        """A part of it."""
        return Relief(self.start[which], self.values[which], self.slopes[which])


class Equations(NamedTuple):
    """Normal matrix (T, T), gradient (T,) and sum of squares of weighted residuals."""

    matrix: Array
    gradient: Array
    cost: float


def bundle_equations(
    sight: Sight, ray: Array, seen: Array, weight: Array, relief: Relief | None, lens_free: bool
) -> Equations:
    """Twin of `procam.kernels.bundle_equations`."""
    total = 0.0
    for at in range(0, len(ray), CHUNK):
        some = slice(at, at + CHUNK)
        part = None if relief is None else relief.some(some)
        error, slopes = bundle_rows(sight, ray[some], seen[some], part, lens_free)
        rows = np.concatenate([slopes, error[..., None]], axis=2)
        rows *= np.sqrt(weight[some])[:, None, None]
        rows = rows[np.isfinite(rows).all(axis=(1, 2))].reshape(-1, rows.shape[2])
        total = total + rows.T @ rows
    products = total + np.zeros((column_count(sight) + 1,) * 2)
    return Equations(products[:-1, :-1], products[:-1, -1], float(products[-1, -1]))


def column_count(sight: Sight) -> int:
    """T, the number of parameters that a camera's view of a projector depends on."""
    return 1 + len(sight.bumps) + 6 + len(sight.camera.lens) + 2 + 6 + len(sight.projector.lens)


def bundle_misses(sight: Sight, ray: Array, seen: Array, relief: Relief | None) -> Array:
    """Twin of `procam.kernels.bundle_misses`."""
    origin, direction = rays_sent(sight.camera, ray)
    hit = on_screen(origin, direction, sight.radius_m, sight.bumps, relief)
    there = hit.point @ sight.projector.rotation.T + sight.projector.translation
    return project_slopes(there, sight.projector.kind, sight.projector.lens)[0] - seen


class Hit(NamedTuple):
    """Where rays meet a screen.

    point (N, 3) [m]; outward (N, 3): gradient there of the height over the screen, measured from the
    centre; values (N, K) of the harmonics there. NaN where a ray misses, or looks away from its relief.
    """

    point: Array
    outward: Array
    values: Array


def on_screen(
    origin: Array, direction: Array, radius_m: float, bumps: Array, relief: Relief | None
) -> Hit:
    """Where rays (N, 3) meet a screen |x| = radius (1 + bumps . harmonics of x/|x|).

    From where the relief is known the harmonics go on as their tangents do; None: a sphere.
    """
    if relief is None:
        along = np.sum(origin * direction, axis=1)
        root = along * along - np.sum(origin * origin, axis=1) + radius_m**2
        reach = np.sqrt(np.where(root >= 0, root, np.nan)) - along
        point = origin + reach[:, None] * direction
        return Hit(point, point / radius_m, np.zeros((len(point), 0)))
    slope = np.einsum("nki,k->ni", relief.slopes, bumps)
    level = 1 + relief.values @ bumps
    near = radius_m * level[:, None] * relief.start - origin
    reach = np.sum(near * direction, axis=1)
    point = origin + np.where(reach > 0, reach, np.nan)[:, None] * direction
    for _ in range(STEPS):
        distance = np.linalg.norm(point, axis=1)
        unit = point / distance[:, None]
        off = unit - relief.start
        across = slope - np.sum(slope * unit, axis=1)[:, None] * unit
        outward = unit - radius_m / distance[:, None] * across
        excess = distance - radius_m * (level + np.sum(slope * off, axis=1))
        point = point - (excess / np.sum(outward * direction, axis=1))[:, None] * direction
    return Hit(point, outward, relief.values + np.einsum("nki,ni->nk", relief.slopes, off))


def bundle_rows(
    sight: Sight, ray: Array, seen: Array, relief: Relief | None, lens_free: bool
) -> tuple[Array, Array]:
    """Residuals (N, 2) [px] and their slopes (N, 2, T), by: screen, camera, projector.

    Screen: log radius, bumps. Camera: turn [rad] and shift [m] in its own frame, lens, pupil, the
    last two 0 unless `lens_free`. Projector: turn, shift, lens.
    """
    camera, projector = sight.camera, sight.projector
    origin, direction = rays_sent(camera, ray)
    hit = on_screen(origin, direction, sight.radius_m, sight.bumps, relief)
    there = hit.point @ projector.rotation.T + projector.translation
    shown, by_there, by_shown_lens = project_slopes(there, projector.kind, projector.lens)
    by_point = by_there @ projector.rotation
    slopes = point_slopes(camera, ray, hit, sight.radius_m, sight.bumps, by_point, lens_free)
    slopes += [_turned(by_there, there), by_there, by_shown_lens]
    return shown - seen, np.concatenate(slopes, axis=2)


def point_slopes(
    camera: Device,
    ray: Array,
    hit: Hit,
    radius_m: float,
    bumps: Array,
    by_point: Array,
    lens_free: bool,
) -> list[Array]:
    """Slopes (N, R, ...) of what follows from the point that a ray (N, 3) hits, given by_point (N, R, 3).

    By log radius and bumps of the screen; by turn, shift, lens and pupil of the camera, the last two
    0 unless `lens_free`.
    """
    origin, direction = rays_sent(camera, ray)
    # a point moves on the screen: what leads off it is made up along the ray
    along = np.sum(hit.outward * direction, axis=1)
    lift = np.einsum("nij,nj->ni", by_point, direction) / along[:, None]
    in_camera = (by_point - lift[..., None] * hit.outward[:, None]) @ camera.rotation.T
    by_height = radius_m * lift[..., None]
    distance = np.sum((hit.point - origin) * direction, axis=1)
    return [
        by_height * (1 + hit.values @ bumps)[:, None, None],
        by_height * hit.values[:, None],
        *_camera_slopes(camera, ray, in_camera, distance, lens_free),
    ]


def _camera_slopes(
    camera: Device, ray: Array, in_camera: Array, distance: Array, lens_free: bool
) -> list[Array]:
    """Slopes (N, R, ...) by turn, shift, lens and pupil, given those by a shift `in_camera`."""
    by_ray = distance[:, None, None] * in_camera
    turn = -_turned(by_ray, ray) - _turned(in_camera, _pupil_place(camera, ray))
    size = in_camera.shape[:2]
    lens, pupil = np.zeros((*size, len(camera.lens))), np.zeros((*size, 2))
    if lens_free:
        theta2, across2 = _angle2(ray), np.sum(ray[:, :2] ** 2, axis=1)
        # z of the ray is cos(theta): theta^2, and with it the start, moves by -2 theta / sin(theta)
        wide = np.sqrt(np.where(across2 > 0, theta2 / np.where(across2 > 0, across2, 1), 1))
        ahead = -2 * wide * (camera.pupil[0] + 2 * camera.pupil[1] * theta2)
        by_ray[..., 2] += ahead[:, None] * in_camera[..., 2]
        lens = by_ray @ ray_slopes(ray, camera.kind, camera.lens)
        pupil = in_camera[..., 2:] * np.stack([theta2, theta2 * theta2], axis=1)[:, None]
    return [turn, -in_camera, lens, pupil]


def rays_sent(camera: Device, ray: Array) -> tuple[Array, Array]:
    """Origins (N, 3) [m] and directions (N, 3) in the dome's frame of a camera's rays (N, 3)."""
    origin = (_pupil_place(camera, ray) - camera.translation) @ camera.rotation
    return origin, ray @ camera.rotation


def _angle2(ray: Array) -> Array:
    """Square (N,) of the angle off the axis [rad^2]."""
    return np.asarray(np.arctan2(np.hypot(ray[:, 0], ray[:, 1]), ray[:, 2]) ** 2)


def _pupil_place(camera: Device, ray: Array) -> Array:
    """Where rays (N, 3) start in the camera's frame (N, 3) [m]."""
    theta2 = _angle2(ray)
    place = np.zeros_like(ray)
    place[:, 2] = theta2 * (camera.pupil[0] + theta2 * camera.pupil[1])
    return place


def _turned(slope: Array, vector: Array) -> Array:
    """Slopes (N, R, 3) by a turn of vectors (N, 3), given those by the vectors."""
    x, y, z = vector.T[:, :, None]
    a, b, c = np.moveaxis(slope, 2, 0)
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=2)
