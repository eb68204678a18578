"""Residuals that fix a rig in space: those of fiducials on the dome and of measured distances."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array
from procam.errors import InputError
from procam.estimate.geometry.model import POSE, PUPIL, ParameterLayout, RigGeometry, device_of
from procam.kernels import PlacedDevice
from procam.kernels.bundle.reference import point_slopes, rays_sent
from procam.maths.geometry.lenses import unproject
from procam.maths.geometry.pose import Pose, align_rotation, rotation_matrix, rotation_vector
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import angles_from_direction, direction_from_angles, normalise
from procam.maths.mesh.shape import MeshShape
from procam.maths.statistics import robust_sigma
from procam.model.optics import Distance, Fiducial

PIXEL_STEP = 0.1  # of a mark's pixel, for numerical derivatives
STEP = 1e-5  # [m] of a point, for numerical derivatives of its residual


def fiducial_rows(
    rig: RigGeometry, fiducials: Sequence[Fiducial], distances: Sequence[Distance]
) -> tuple[Array, Array]:
    """Residuals (M,) of fiducials and distances over their sigmas, and derivatives (M, P)."""
    layout = ParameterLayout.of(rig)
    error, rows = fiducial_residuals(rig, fiducials, distances), [np.zeros((0, layout.count))]
    for fiducial, point, by_parameters in zip(
        fiducials, *_drawn_slopes(rig, fiducials, layout), strict=True
    ):
        by_point = [
            _residual(fiducial, normalise(point + step))
            - _residual(fiducial, normalise(point - step))
            for step in STEP * np.eye(3)
        ]
        rows.append(np.stack(by_point, axis=1) / (2 * STEP) @ by_parameters)
    for distance in distances:
        (a, by_a), (b, by_b) = (
            _position(rig, fiducials, name, layout) for name in (distance.a, distance.b)
        )
        along = (a - b) / np.linalg.norm(a - b)
        rows.append((along @ (by_a - by_b) / distance.sigma_m)[None])
    return error, np.concatenate(rows)


def with_camera_errors(rig: RigGeometry, fiducials: Sequence[Fiducial]) -> list[Fiducial]:
    """Fiducials in a room, where an error of a pixel may be a larger angle about the room's origin.

    A camera that is nearer to its mark than the origin makes less of it, and one that looks along the wall
    makes more. In a dome both see it from about the middle. Marks are measured from edges of walls; if those
    are not where they were drawn, marks are as far off as most of them disagree.
    """
    if not isinstance(rig.shape, MeshShape):
        return list(fiducials)
    marks = [_with_camera_error(rig, each) for each in fiducials]
    if not rig.shape.moves.any():
        return marks
    apart = max(1.0, robust_sigma(fiducial_residuals(rig, marks, ()), 0.0))
    return [replace(mark, sigma=apart * mark.sigma) for mark in marks]


def loosened(shape: RoundShape, fiducials: Sequence[Fiducial], metres: float) -> list[Fiducial]:
    """Fiducials of known direction on a screen, with so much more in their standard errors."""
    angles = np.array([(f.azimuth or 0.0, f.elevation or 0.0) for f in fiducials]).reshape(-1, 2)
    away = shape.radius_at(direction_from_angles(*angles.T))
    return [
        replace(mark, sigma=float(np.hypot(mark.sigma, metres / far)))
        for mark, far in zip(fiducials, away, strict=True)
    ]


def _with_camera_error(rig: RigGeometry, fiducial: Fiducial) -> Fiducial:
    if not fiducial.camera_sigma or fiducial.device not in rig.cameras:
        return fiducial
    focal = rig.cameras[fiducial.device].lens.focal
    there = normalise(fiducial_point(rig, fiducial))
    slopes = [
        (normalise(fiducial_point(rig, _moved(fiducial, step))) - there) * focal[i] / PIXEL_STEP
        for i, step in enumerate(PIXEL_STEP * np.eye(2))
    ]
    larger = float(np.linalg.norm(np.nan_to_num(slopes, nan=1.0), 2))
    added = (larger**2 - 1) * fiducial.camera_sigma**2
    return replace(fiducial, sigma=float(np.sqrt(fiducial.sigma**2 + added)))


def _moved(fiducial: Fiducial, step: Array) -> Fiducial:
    return replace(fiducial, pixel=np.asarray(fiducial.pixel, float) + step)


def fiducial_residuals(
    rig: RigGeometry, fiducials: Sequence[Fiducial], distances: Sequence[Distance]
) -> Array:
    """Residuals (M,) of fiducials and distances over their sigmas."""
    seen = normalise(fiducial_points(rig, fiducials))
    parts = [_residual(*each) for each in zip(fiducials, seen, strict=True)]
    parts += [
        np.array([distance_in_rig(rig, fiducials, d) - d.metres]) / d.sigma_m for d in distances
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def fiducial_point(rig: RigGeometry, fiducial: Fiducial) -> Array:
    """The point (3,) [m] of the screen where a fiducial's device sees it, or projects it."""
    return fiducial_points(rig, [fiducial])[0]


def fiducial_points(rig: RigGeometry, fiducials: Sequence[Fiducial]) -> Array:
    """The points (M, 3) [m] of the screen where the fiducials' devices see, or project, them.

    On walls that moved they are places where the drawing has them, as stated places are on the drawing.
    """
    points = np.zeros((len(fiducials), 3))
    for name, own in _by_device(fiducials).items():
        device, rays = _device_of(rig, name, [fiducials[i] for i in own])
        points[own] = rig.shape.intersect(*rays_sent(device, rays))
    return rig.shape.drawn(points) if isinstance(rig.shape, MeshShape) else points


def _by_device(fiducials: Sequence[Fiducial]) -> dict[str, list[int]]:
    """Numbers of the fiducials of each device."""
    names = dict.fromkeys(f.device for f in fiducials)
    return {name: [i for i, f in enumerate(fiducials) if f.device == name] for name in names}


def _drawn_slopes(
    rig: RigGeometry, fiducials: Sequence[Fiducial], layout: ParameterLayout
) -> tuple[Array, Array]:
    """`fiducial_points`, and their derivatives (M, 3, P) by the rig's parameters."""
    points, slopes = _point_slopes(rig, fiducials, layout)
    if isinstance(rig.shape, MeshShape):
        slopes[..., layout.screen][..., 2:] -= np.moveaxis(rig.shape.moved_at(points), 1, 2)
        points = rig.shape.drawn(points)
    return points, slopes


def _point_slopes(
    rig: RigGeometry, fiducials: Sequence[Fiducial], layout: ParameterLayout
) -> tuple[Array, Array]:
    """Points (M, 3) [m] that fiducials' devices see, and derivatives (M, 3, P) by the rig's parameters."""
    shape, coefficients = rig.shape, rig.shape.harmonic_coefficients
    points, slopes = np.zeros((len(fiducials), 3)), np.zeros((len(fiducials), 3, layout.count))
    for name, own in _by_device(fiducials).items():
        device, rays = _device_of(rig, name, [fiducials[i] for i in own])
        hit = shape.hit(*rays_sent(device, rays))
        points[own], by_point = hit.point, np.tile(np.eye(3), (len(own), 1, 1))
        parts = point_slopes(device, rays, hit, shape.radius_m, coefficients, by_point, True)
        by_own = np.concatenate(parts, axis=2)
        columns = np.r_[layout.screen, _block(layout, name)]
        # a projector has no pupil parameters
        slopes[np.ix_(own, range(3), columns)] = by_own[..., : len(columns)]
    return points, slopes


def _device_of(
    rig: RigGeometry, name: str, fiducials: Sequence[Fiducial]
) -> tuple[PlacedDevice, Array]:
    """A camera or projector, and the rays (M, 3) of the pixels of its fiducials."""
    pixels = np.array([f.pixel for f in fiducials], float)
    if name in rig.cameras:
        camera = rig.cameras[name]
        assert camera.camera_from_dome is not None
        device = device_of(camera.camera_from_dome, camera.lens, camera.pupil)
        return device, unproject(pixels, camera.lens)
    projector = rig.projectors[name]
    device = device_of(projector.projector_from_dome, projector.lens, np.zeros(PUPIL))
    return device, unproject(pixels, projector.lens)


def _block(layout: ParameterLayout, name: str) -> slice:
    """The parameters of a device."""
    return layout.cameras[name] if name in layout.cameras else layout.projectors[name]


def _residual(fiducial: Fiducial, seen: Array) -> Array:
    """Residuals over sigma of a fiducial seen in a direction (3,), one per known angle."""
    azimuth, elevation = (float(a) for a in angles_from_direction(seen))
    known_azimuth, known_elevation = fiducial.azimuth, fiducial.elevation
    if known_azimuth is not None and known_elevation is not None:
        # two tangents at the known direction: differences of angles would fail near the pole
        known = direction_from_angles(known_azimuth, known_elevation)
        east = direction_from_angles(known_azimuth + np.pi / 2, 0.0)
        return np.array([seen @ east, seen @ np.cross(known, east)]) / fiducial.sigma
    if known_elevation is not None:
        return np.array([elevation - known_elevation]) / fiducial.sigma
    assert known_azimuth is not None
    off = np.remainder(azimuth - known_azimuth + np.pi, 2 * np.pi) - np.pi
    return np.array([off * np.cos(elevation)]) / fiducial.sigma


def distance_in_rig(rig: RigGeometry, fiducials: Sequence[Fiducial], distance: Distance) -> float:
    """A distance as the rig has it [m]."""
    layout = ParameterLayout.of(rig)
    ends = [_position(rig, fiducials, name, layout)[0] for name in (distance.a, distance.b)]
    return float(np.linalg.norm(ends[0] - ends[1]))


def _position(
    rig: RigGeometry, fiducials: Sequence[Fiducial], name: str, layout: ParameterLayout
) -> tuple[Array, Array]:
    """Position (3,) [m] of a camera, projector or fiducial, and its derivatives (3, P)."""
    pose = None
    if name in rig.cameras:
        pose = rig.cameras[name].camera_from_dome
    elif name in rig.projectors:
        pose = rig.projectors[name].projector_from_dome
    if pose is not None:
        slopes = np.zeros((3, layout.count))
        slopes[:, _block(layout, name)][:, 3:POSE] = -pose.rotation.T
        return pose.origin, slopes
    for fiducial in fiducials:
        if fiducial.name == name:
            point, slopes = _point_slopes(rig, [fiducial], layout)
            return point[0], slopes[0]
    raise InputError(
        f"distances: {name!r} is not a camera, projector or fiducial of this venue. Use one of "
        f"{', '.join([*rig.cameras, *rig.projectors, *(f.name for f in fiducials)])}."
    )


def rotated_to_fiducials(rig: RigGeometry, fiducials: Sequence[Fiducial]) -> RigGeometry:
    """The rig rotated about the screen's centre to the known directions of the fiducials."""
    if not fiducials:
        return rig
    seen = normalise(fiducial_points(rig, fiducials))
    return rotated(rig, best_rotation(fiducials, seen)[0])


def best_rotation(fiducials: Sequence[Fiducial], seen: Array) -> tuple[Array, list[Array]]:
    """The rotation (3, 3) of directions (N, 3) that fits the fiducials best, and the residuals."""

    def errors(vector: Array) -> list[Array]:
        rotated = seen @ rotation_matrix(vector).T
        return [_residual(f, d) for f, d in zip(fiducials, rotated, strict=True)]

    full = [f.azimuth is not None and f.elevation is not None for f in fiducials]
    if sum(full) > 1:
        known = [direction_from_angles(f.azimuth or 0.0, f.elevation or 0.0) for f in fiducials]
        starts = [rotation_vector(align_rotation(seen[full], np.array(known)[full]))]
    else:
        starts = [np.array([x, 0.0, z]) for x in (0.0, 1.5, 3.0) for z in (-2.0, 0.0, 2.0)]

    def joined(vector: Array) -> Array:
        return np.concatenate(errors(vector))

    fits = [least_squares(joined, start, x_scale=0.1) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    return rotation_matrix(best), errors(best)


def rotated(rig: RigGeometry, rotation: Array) -> RigGeometry:
    """A rig on an exact sphere, rotated (3, 3) about the centre; no residual changes."""

    def move(pose: Pose) -> Pose:
        return Pose(pose.rotation @ rotation.T, pose.translation)

    cameras = {
        n: replace(c, camera_from_dome=move(c.camera_from_dome))
        for n, c in rig.cameras.items()
        if c.camera_from_dome is not None
    }
    projectors = {
        n: replace(p, projector_from_dome=move(p.projector_from_dome))
        for n, p in rig.projectors.items()
    }
    return RigGeometry(rig.shape, cameras, projectors)
