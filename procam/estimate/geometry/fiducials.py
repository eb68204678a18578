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
from procam.maths.geometry.sphere import angles_from_direction, direction_from_angles, normalise
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import Distance, Fiducial

PIXEL_STEP = 0.1  # of a mark's pixel, for numerical derivatives
STEP = 1e-5  # [m] of a point, for numerical derivatives of its residual


def fiducial_rows(
    rig: RigGeometry, fiducials: Sequence[Fiducial], distances: Sequence[Distance]
) -> tuple[Array, Array]:
    """Residuals (M,) of fiducials and distances over their sigmas, and derivatives (M, P)."""
    layout = ParameterLayout.of(rig)
    error, rows = fiducial_residuals(rig, fiducials, distances), [np.zeros((0, layout.count))]
    for fiducial in fiducials:
        point, by_parameters = _point_slopes(rig, fiducial, layout)
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
    makes more. In a dome both see it from about the middle.
    """
    if not isinstance(rig.shape, MeshShape):
        return list(fiducials)
    return [_with_camera_error(rig, each) for each in fiducials]


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
    parts = [_residual(f, normalise(fiducial_point(rig, f))) for f in fiducials]
    parts += [
        np.array([distance_in_rig(rig, fiducials, d) - d.metres]) / d.sigma_m for d in distances
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def fiducial_point(rig: RigGeometry, fiducial: Fiducial) -> Array:
    """The point (3,) [m] of the screen where a fiducial's device sees it, or projects it."""
    device, ray = _device_of(rig, fiducial)
    return rig.shape.intersect(*rays_sent(device, ray))[0]


def _point_slopes(
    rig: RigGeometry, fiducial: Fiducial, layout: ParameterLayout
) -> tuple[Array, Array]:
    """`fiducial_point`, and its derivatives (3, P) by the rig's parameters."""
    device, ray = _device_of(rig, fiducial)
    hit = rig.shape.hit(*rays_sent(device, ray))
    shape, identity = rig.shape, np.eye(3)[None]
    coefficients = shape.harmonic_coefficients
    parts = point_slopes(device, ray, hit, shape.radius_m, coefficients, identity, lens_free=True)
    by_own = np.concatenate(parts, axis=2)[0]
    columns = np.r_[layout.screen, _block(layout, fiducial.device)]
    slopes = np.zeros((3, layout.count))
    slopes[:, columns] = by_own[:, : len(columns)]  # a projector has no pupil parameters
    return hit.point[0], slopes


def _device_of(rig: RigGeometry, fiducial: Fiducial) -> tuple[PlacedDevice, Array]:
    """The device of a fiducial, and the ray (1, 3) of its pixel."""
    pixel = np.asarray(fiducial.pixel, float)[None]
    if fiducial.device in rig.cameras:
        camera = rig.cameras[fiducial.device]
        assert camera.camera_from_dome is not None
        device = device_of(camera.camera_from_dome, camera.lens, camera.pupil)
        return device, unproject(pixel, camera.lens)
    projector = rig.projectors[fiducial.device]
    device = device_of(projector.projector_from_dome, projector.lens, np.zeros(PUPIL))
    return device, unproject(pixel, projector.lens)


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
            return _point_slopes(rig, fiducial, layout)
    raise InputError(
        f"distances: {name!r} is not a camera, projector or fiducial of this venue. Use one of "
        f"{', '.join([*rig.cameras, *rig.projectors, *(f.name for f in fiducials)])}."
    )


def rotated_to_fiducials(rig: RigGeometry, fiducials: Sequence[Fiducial]) -> RigGeometry:
    """The rig rotated about the screen's centre to the known directions of the fiducials."""
    if not fiducials:
        return rig
    seen = normalise(np.array([fiducial_point(rig, f) for f in fiducials]))
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
