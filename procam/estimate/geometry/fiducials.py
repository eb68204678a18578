"""What fixes a rig in space: fiducials on the dome, and distances somebody measured."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from procam.errors import InputError
from procam.estimate.geometry.model import POSE, PUPIL, ParameterLayout, RigGeometry, device_of
from procam.kernels import PlacedDevice
from procam.kernels.bundle.reference import point_slopes, rays_sent
from procam.maths.geometry.lenses import unproject
from procam.maths.geometry.pose import Pose, align_rotation, rotation_matrix, rotation_vector
from procam.maths.geometry.sphere import angles_from_direction, direction_from_angles, normalise
from procam.model.optics import Distance, Fiducial

Array = NDArray[np.float64]
STEP = 1e-5  # [m] of a point, for slopes of what is wrong with it


def mark_rows(
    rig: RigGeometry, fiducials: Sequence[Fiducial], distances: Sequence[Distance]
) -> tuple[Array, Array]:
    """Residuals (M,) of all marks in their own sigmas, and slopes (M, P) by the rig's parameters."""
    layout = ParameterLayout.of(rig)
    error, rows = mark_errors(rig, fiducials, distances), [np.zeros((0, layout.count))]
    for fiducial in fiducials:
        point, moves = _seen_point(rig, fiducial, layout)
        by_point = [
            _off(fiducial, normalise(point + step)) - _off(fiducial, normalise(point - step))
            for step in STEP * np.eye(3)
        ]
        rows.append(np.stack(by_point, axis=1) / (2 * STEP) @ moves)
    for distance in distances:
        (a, by_a), (b, by_b) = (
            _place(rig, fiducials, name, layout) for name in (distance.a, distance.b)
        )
        along = (a - b) / np.linalg.norm(a - b)
        rows.append((along @ (by_a - by_b) / distance.sigma_m)[None])
    return error, np.concatenate(rows)


def mark_errors(
    rig: RigGeometry, fiducials: Sequence[Fiducial], distances: Sequence[Distance]
) -> Array:
    """Residuals (M,) of all marks in their own sigmas."""
    parts = [_off(f, normalise(seen_point(rig, f))) for f in fiducials]
    parts += [np.array([length_of(rig, fiducials, d) - d.metres]) / d.sigma_m for d in distances]
    return np.concatenate(parts) if parts else np.zeros(0)


def seen_point(rig: RigGeometry, fiducial: Fiducial) -> Array:
    """The point (3,) [m] of the screen where its device sees, or shows, a fiducial."""
    device, ray = _device_of(rig, fiducial)
    return rig.shape.meet(*rays_sent(device, ray))[0]


def _seen_point(
    rig: RigGeometry, fiducial: Fiducial, layout: ParameterLayout
) -> tuple[Array, Array]:
    """`seen_point`, and its slopes (3, P)."""
    device, ray = _device_of(rig, fiducial)
    hit = rig.shape.hit(*rays_sent(device, ray))
    shape, identity = rig.shape, np.eye(3)[None]
    parts = point_slopes(device, ray, hit, shape.radius_m, shape.bumps, identity, lens_free=True)
    found = np.concatenate(parts, axis=2)[0]
    columns = np.r_[layout.screen, _block(layout, fiducial.device)]
    slopes = np.zeros((3, layout.count))
    slopes[:, columns] = found[:, : len(columns)]  # a projector has no pupil to move
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
    """Where a device's parameters stand."""
    return layout.cameras[name] if name in layout.cameras else layout.projectors[name]


def _off(fiducial: Fiducial, seen: Array) -> Array:
    """What is wrong with a fiducial that is seen in a direction (3,), along the angles known [sigma]."""
    azimuth, elevation = (float(a) for a in angles_from_direction(seen))
    known_azimuth, known_elevation = fiducial.azimuth, fiducial.elevation
    if known_azimuth is not None and known_elevation is not None:
        # two tangents at the known place: angles of their own would fail near the pole
        place = direction_from_angles(known_azimuth, known_elevation)
        east = direction_from_angles(known_azimuth + np.pi / 2, 0.0)
        return np.array([seen @ east, seen @ np.cross(place, east)]) / fiducial.sigma
    if known_elevation is not None:
        return np.array([elevation - known_elevation]) / fiducial.sigma
    assert known_azimuth is not None
    off = np.remainder(azimuth - known_azimuth + np.pi, 2 * np.pi) - np.pi
    return np.array([off * np.cos(elevation)]) / fiducial.sigma


def length_of(rig: RigGeometry, fiducials: Sequence[Fiducial], distance: Distance) -> float:
    """How long a distance is in a rig [m]."""
    layout = ParameterLayout.of(rig)
    ends = [_place(rig, fiducials, name, layout)[0] for name in (distance.a, distance.b)]
    return float(np.linalg.norm(ends[0] - ends[1]))


def _place(
    rig: RigGeometry, fiducials: Sequence[Fiducial], name: str, layout: ParameterLayout
) -> tuple[Array, Array]:
    """Where a camera, projector or fiducial of that name is (3,) [m], and its slopes (3, P)."""
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
            return _seen_point(rig, fiducial, layout)
    raise InputError(
        f"distances: got {name!r}, expected a camera, projector or fiducial: "
        f"{', '.join([*rig.cameras, *rig.projectors, *(f.name for f in fiducials)])}"
    )


def turned_to_fiducials(rig: RigGeometry, fiducials: Sequence[Fiducial]) -> RigGeometry:
    """The whole rig turned, about the screen's centre, to where the fiducials are said to be."""
    if not fiducials:
        return rig
    seen = normalise(np.array([seen_point(rig, f) for f in fiducials]))
    return turned(rig, best_turn(fiducials, seen)[0])


def best_turn(fiducials: Sequence[Fiducial], seen: Array) -> tuple[Array, list[Array]]:
    """The turn (3, 3) that brings directions (N, 3) to the fiducials, and what is left [sigma]."""

    def miss(turn: Array) -> list[Array]:
        places = seen @ rotation_matrix(turn).T
        return [_off(f, p) for f, p in zip(fiducials, places, strict=True)]

    full = [f.azimuth is not None and f.elevation is not None for f in fiducials]
    if sum(full) > 1:
        known = [direction_from_angles(f.azimuth or 0.0, f.elevation or 0.0) for f in fiducials]
        starts = [rotation_vector(align_rotation(seen[full], np.array(known)[full]))]
    else:
        tips, spins = (0.0, 1.5, 3.0), (-2.0, 0.0, 2.0)
        starts = [np.array([tip, 0.0, spin]) for tip in tips for spin in spins]

    def joined(turn: Array) -> Array:
        return np.concatenate(miss(turn))

    fits = [least_squares(joined, start, x_scale=0.1) for start in starts]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    return rotation_matrix(best), miss(best)


def turned(rig: RigGeometry, turn: Array) -> RigGeometry:
    """A rig round an exact sphere, seen in axes turned by a rotation (3, 3): the same light."""

    def move(pose: Pose) -> Pose:
        return Pose(pose.rotation @ turn.T, pose.translation)

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
