"""The bundle adjustment in NumPy: the reference implementation of `procam.kernels.bundle`.

It runs where there is no compiled library, and the tests hold the library against it.
"""

from typing import NamedTuple

import numpy as np

from procam.arrays import Array
from procam.kernels.bundle.lenses import project_slopes, ray_slopes

STEPS = 3  # from near the screen onto it
CHUNK = 4096  # observations at a time, which stay in the cache


class PlacedDevice(NamedTuple):
    """A placed camera or projector: x_device = rotation @ x_dome + translation.

    rotation (3, 3), translation (3,) [m]; kind and lens (P,) as in `lenses`; pupil (2,):
    rays off the axis by theta start pupil[0] theta^2 + pupil[1] theta^4 [m] ahead on it.
    """

    rotation: Array
    translation: Array
    kind: str
    lens: Array
    pupil: Array


class ObservationBlock(NamedTuple):
    """A camera and a projector that it observes on a screen of radius [m] with harmonics (K,)."""

    camera: PlacedDevice
    projector: PlacedDevice
    radius_m: float
    harmonic_coefficients: Array


class ShapeDerivatives(NamedTuple):
    """A screen's harmonics in the directions where rays meet its sphere, to first order.

    start (N, 3): those unit directions; values (N, K) and slopes (N, K, 3) of the harmonics there.
    """

    start: Array
    values: Array
    slopes: Array

    def part(self, which: slice) -> "ShapeDerivatives":
        """Those of some rays."""
        return ShapeDerivatives(self.start[which], self.values[which], self.slopes[which])


class NormalEquations(NamedTuple):
    """Normal matrix (T, T), gradient (T,) and sum of squares of weighted residuals."""

    matrix: Array
    gradient: Array
    cost: float


def bundle_equations(
    block: ObservationBlock,
    ray: Array,
    seen: Array,
    weight: Array,
    derivatives: ShapeDerivatives | None,
    lens_free: bool,
) -> NormalEquations:
    """See `procam.kernels.bundle_equations`."""
    total = 0.0
    for at in range(0, len(ray), CHUNK):
        part = slice(at, at + CHUNK)
        shape = None if derivatives is None else derivatives.part(part)
        error, slopes = bundle_rows(block, ray[part], seen[part], shape, lens_free)
        rows = np.concatenate([slopes, error[..., None]], axis=2)
        rows *= np.sqrt(weight[part])[:, None, None]
        rows = rows[np.isfinite(rows).all(axis=(1, 2))].reshape(-1, rows.shape[2])
        total = total + rows.T @ rows
    products = total + np.zeros((column_count(block) + 1,) * 2)
    return NormalEquations(products[:-1, :-1], products[:-1, -1], float(products[-1, -1]))


def column_count(block: ObservationBlock) -> int:
    """T, the number of parameters that a camera's view of a projector depends on."""
    return (
        1
        + len(block.harmonic_coefficients)
        + 6
        + len(block.camera.lens)
        + 2
        + 6
        + len(block.projector.lens)
    )


def bundle_residuals(
    block: ObservationBlock, ray: Array, seen: Array, derivatives: ShapeDerivatives | None
) -> Array:
    """See `procam.kernels.bundle_residuals`."""
    origin, direction = rays_sent(block.camera, ray)
    hit = on_screen(origin, direction, block.radius_m, block.harmonic_coefficients, derivatives)
    in_projector = hit.point @ block.projector.rotation.T + block.projector.translation
    return project_slopes(in_projector, block.projector.kind, block.projector.lens)[0] - seen


class Hit(NamedTuple):
    """Where rays meet a screen.

    point (N, 3) [m]; outward (N, 3): gradient there of the height over the screen, measured from the
    centre; values (N, K) of the harmonics there. NaN where a ray misses, or points away from `start`.
    """

    point: Array
    outward: Array
    values: Array


def on_screen(
    origin: Array,
    direction: Array,
    radius_m: float,
    harmonic_coefficients: Array,
    derivatives: ShapeDerivatives | None,
) -> Hit:
    """Where rays (N, 3) meet a screen |x| = radius (1 + coefficients . harmonics of x/|x|).

    The harmonics are linear around the start of `derivatives`; None: a sphere.
    """
    if derivatives is None:
        along = np.sum(origin * direction, axis=1)
        root = along * along - np.sum(origin * origin, axis=1) + radius_m**2
        reach = np.sqrt(np.where(root >= 0, root, np.nan)) - along
        point = origin + reach[:, None] * direction
        return Hit(point, point / radius_m, np.zeros((len(point), 0)))
    slope = np.einsum("nki,k->ni", derivatives.slopes, harmonic_coefficients)
    level = 1 + derivatives.values @ harmonic_coefficients
    near = radius_m * level[:, None] * derivatives.start - origin
    reach = np.sum(near * direction, axis=1)
    point = origin + np.where(reach > 0, reach, np.nan)[:, None] * direction
    for _ in range(STEPS):
        distance = np.linalg.norm(point, axis=1)
        unit = point / distance[:, None]
        off = unit - derivatives.start
        across = slope - np.sum(slope * unit, axis=1)[:, None] * unit
        outward = unit - radius_m / distance[:, None] * across
        excess = distance - radius_m * (level + np.sum(slope * off, axis=1))
        point = point - (excess / np.sum(outward * direction, axis=1))[:, None] * direction
    return Hit(
        point, outward, derivatives.values + np.einsum("nki,ni->nk", derivatives.slopes, off)
    )


def bundle_rows(
    block: ObservationBlock,
    ray: Array,
    seen: Array,
    derivatives: ShapeDerivatives | None,
    lens_free: bool,
) -> tuple[Array, Array]:
    """Residuals (N, 2) [px] and their slopes (N, 2, T), by: screen, camera, projector.

    Screen: log radius, harmonic coefficients. Camera: rotation [rad] and translation [m] in its own
    frame, lens, pupil, the last two 0 unless `lens_free`. Projector: rotation, translation, lens.
    """
    camera, projector = block.camera, block.projector
    origin, direction = rays_sent(camera, ray)
    hit = on_screen(origin, direction, block.radius_m, block.harmonic_coefficients, derivatives)
    in_projector = hit.point @ projector.rotation.T + projector.translation
    predicted, by_place, by_lens = project_slopes(in_projector, projector.kind, projector.lens)
    by_point = by_place @ projector.rotation
    slopes = point_slopes(
        camera, ray, hit, block.radius_m, block.harmonic_coefficients, by_point, lens_free
    )
    slopes += [_turned(by_place, in_projector), by_place, by_lens]
    return predicted - seen, np.concatenate(slopes, axis=2)


def point_slopes(
    camera: PlacedDevice,
    ray: Array,
    hit: Hit,
    radius_m: float,
    harmonic_coefficients: Array,
    by_point: Array,
    lens_free: bool,
) -> list[Array]:
    """Slopes (N, R, ...) of what follows from the point that a ray (N, 3) hits, given by_point (N, R, 3).

    By log radius and harmonic coefficients of the screen; by rotation, translation, lens and pupil of
    the camera, the last two 0 unless `lens_free`.
    """
    origin, direction = rays_sent(camera, ray)
    # the point stays on the screen: a step off it is compensated along the ray
    along = np.sum(hit.outward * direction, axis=1)
    lift = np.einsum("nij,nj->ni", by_point, direction) / along[:, None]
    in_camera = (by_point - lift[..., None] * hit.outward[:, None]) @ camera.rotation.T
    by_height = radius_m * lift[..., None]
    distance = np.sum((hit.point - origin) * direction, axis=1)
    return [
        by_height * (1 + hit.values @ harmonic_coefficients)[:, None, None],
        by_height * hit.values[:, None],
        *_camera_slopes(camera, ray, in_camera, distance, lens_free),
    ]


def _camera_slopes(
    camera: PlacedDevice, ray: Array, in_camera: Array, distance: Array, lens_free: bool
) -> list[Array]:
    """Slopes (N, R, ...) by rotation, translation, lens and pupil, given those by a translation."""
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


def rays_sent(camera: PlacedDevice, ray: Array) -> tuple[Array, Array]:
    """Origins (N, 3) [m] and directions (N, 3) in the dome's frame of a camera's rays (N, 3)."""
    origin = (_pupil_place(camera, ray) - camera.translation) @ camera.rotation
    return origin, ray @ camera.rotation


def _angle2(ray: Array) -> Array:
    """Square (N,) of the angle off the axis [rad^2]."""
    return np.asarray(np.arctan2(np.hypot(ray[:, 0], ray[:, 1]), ray[:, 2]) ** 2)


def _pupil_place(camera: PlacedDevice, ray: Array) -> Array:
    """Where rays (N, 3) start in the camera's frame (N, 3) [m]."""
    theta2 = _angle2(ray)
    place = np.zeros_like(ray)
    place[:, 2] = theta2 * (camera.pupil[0] + theta2 * camera.pupil[1])
    return place


def _turned(slope: Array, vector: Array) -> Array:
    """Slopes (N, R, 3) by a rotation of vectors (N, 3), given those by the vectors."""
    x, y, z = vector.T[:, :, None]
    a, b, c = np.moveaxis(slope, 2, 0)
    return np.stack([y * c - z * b, z * a - x * c, x * b - y * a], axis=2)
