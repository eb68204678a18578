"""Camera observations of projector pixels without rendering light, for studies of geometry.

A projector pixel is traced to the dome and into a camera, and its position gets a decoder's error.
"""

from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.pose import Pose, rotation_matrix
from simulators.builds import CameraBuild, ProjectorBuild
from simulators.surface import Surface

PUPIL_STEPS = 6


def perturb_rig(
    builds: list[ProjectorBuild], cameras: list[CameraBuild], rng: np.random.Generator
) -> tuple[list[ProjectorBuild], list[CameraBuild]]:
    """The same rig installed differently: rotated by degrees, moved by decimetres, other zoom."""
    projectors = [
        replace(
            b,
            projector_from_dome=_perturbed(b.projector_from_dome, 0.06, 0.15, rng),
            lens=replace(
                b.lens,
                focal=b.lens.focal * (1 + rng.normal(0, 0.03)),
                centre=b.lens.centre + rng.normal(0, 0.05, 2) * b.size,
                distortion=b.lens.distortion * (1 + rng.normal(0, 0.3)),
            ),
        )
        for b in builds
    ]
    placed = [
        replace(c, camera_from_dome=_perturbed(c.camera_from_dome, 0.15, 0.4, rng)) for c in cameras
    ]
    return projectors, placed


def lit_points(surface: Surface, build: ProjectorBuild, pixels: Array) -> Array:
    """Points (N, 3) [m] that projector pixels (N, 2) light; NaN beyond the blackout plates."""
    back = build.projector_from_dome.inverse()
    rays = back.rotate(unproject(pixels, build.lens))
    point = surface.intersect(np.broadcast_to(back.translation, rays.shape), rays)
    up = point[:, 2] / np.linalg.norm(point, axis=1)
    lit = up >= np.cos(surface.lit_half_angle)
    return np.where(lit[:, None], point, np.nan)


def camera_pixels(camera: CameraBuild, points: Array) -> Array:
    """Camera pixels (N, 2) of points (N, 3) [m]; NaN outside of the picture."""
    place = camera.camera_from_dome.apply(points)
    shift = np.zeros(len(points))
    for _ in range(PUPIL_STEPS if any(camera.pupil) else 1):
        moved = place - shift[:, None] * [0.0, 0.0, 1.0]
        theta2 = np.arctan2(np.hypot(moved[:, 0], moved[:, 1]), moved[:, 2]) ** 2
        shift = theta2 * (camera.pupil[0] + theta2 * camera.pupil[1])
    pixels = project(moved, camera.lens)
    radius = np.linalg.norm(pixels - camera.lens.centre, axis=1)
    inside = ((pixels > -0.5) & (pixels < np.array(camera.size) - 0.5)).all(axis=1)
    return np.where((inside & (radius < min(camera.size) / 2))[:, None], pixels, np.nan)


def simulate_observations(
    surface: Surface,
    build: ProjectorBuild,
    camera: CameraBuild,
    patch_px: int,
    sigma_px: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Camera pixels (N, 2) of the centres (N, 2) of a panel's patches, with an error of `sigma_px`.

    The error is in projector pixels, as a decoder's.
    """
    width, height = build.size
    x, y = (np.arange(patch_px / 2 - 0.5, n, patch_px) for n in (width, height))
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    off = centres + rng.normal(0, sigma_px, centres.shape)
    seen = camera_pixels(camera, lit_points(surface, build, off))
    keep = np.isfinite(seen).all(axis=1)
    return seen[keep], centres[keep]


def _perturbed(pose: Pose, angle: float, shift_m: float, rng: np.random.Generator) -> Pose:
    rotation = rotation_matrix(rng.normal(0, angle, 3)) @ pose.rotation
    return Pose(rotation, -rotation @ (pose.origin + rng.normal(0, shift_m, 3)))
