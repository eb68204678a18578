"""Where projector pixels land, how large they are, how sure that is, and which of them are lit."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry import (
    CAMERA_PARAMETERS,
    PROJECTOR_PARAMETERS,
    GeometrySolution,
    changed_projector,
    step_sizes,
)
from procam.estimate.transport import Light
from procam.maths.lenses import project, unproject
from procam.maths.sphere import grid_solid_angles, intersect_sphere, normalise
from procam.maths.warp import sample
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import CameraModel, ProjectorModel
from procam.model.screen import Dome

Array = NDArray[np.float64]
SIGMA_GRID_PX = 32
LIT_HALF = 0.5  # a border pixel counts when half of its light arrives


def directions(projector: ProjectorModel, dome: Dome, x: NDArray[Any], y: NDArray[Any]) -> Array:
    """Directions (len(y), len(x), 3) from the dome's centre of projector pixels; NaN if they miss."""
    pixels = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
    back = projector.projector_from_dome.inverse()
    rays = back.rotate(unproject(pixels, projector.lens))
    return normalise(intersect_sphere(back.translation, rays, dome.radius_m))


def project_surface(
    solution: GeometrySolution, name: str, dome: Dome, light: Light
) -> ProjectorSurface:
    """The surface of projector `name`; `light` tells which pixels really arrive on the screen."""
    projector = solution.projectors[name]
    width, height = projector.size
    direction = directions(projector, dome, np.arange(width), np.arange(height))
    corners = directions(projector, dome, np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
    on_screen = direction[..., 2] >= np.cos(dome.half_angle)
    measured = np.where(on_screen, lit_share(solution.camera, dome, direction, light), 0)
    return ProjectorSurface(
        direction.astype(np.float32),
        grid_solid_angles(corners).astype(np.float32),
        measured > LIT_HALF,
        measured.astype(np.float32),
        _direction_sigma(solution, name, dome),
    )


def camera_pixels(camera: CameraModel, dome: Dome, direction: NDArray[np.floating]) -> Array:
    """Camera pixel (..., 2) that sees the dome in directions (..., 3)."""
    assert camera.camera_from_dome is not None
    points = dome.radius_m * np.asarray(direction, float)
    return project(camera.camera_from_dome.apply(points), camera.lens)


def lit_share(
    camera: CameraModel, dome: Dome, direction: NDArray[np.floating], light: Light
) -> NDArray[np.float32]:
    """Share 0..1 (...) of the light expected in directions (..., 3) that the camera really saw."""
    xy = camera_pixels(camera, dome, direction)
    seen, expected = sample(light.direct[..., 1], xy), sample(light.extended[..., 1], xy)
    floor = 0.02 * float(np.percentile(light.extended[..., 1], 99))
    share = np.where(expected > floor, seen / np.maximum(expected, floor), 0)
    return np.asarray(np.clip(share, 0, 1), np.float32)


def _direction_sigma(solution: GeometrySolution, name: str, dome: Dome) -> NDArray[np.float32]:
    """Standard error (H, W) [arcmin], propagated on a coarse grid and interpolated."""
    projector = solution.projectors[name]
    width, height = projector.size
    columns, rows = -(-width // SIGMA_GRID_PX) + 1, -(-height // SIGMA_GRID_PX) + 1
    x, y = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    steps = step_sizes(projector, dome)[CAMERA_PARAMETERS:]
    gradient = []
    for i, step in enumerate(steps):
        change = np.zeros(PROJECTOR_PARAMETERS)
        change[i] = step
        ahead = directions(changed_projector(projector, change), dome, x, y)
        behind = directions(changed_projector(projector, -change), dome, x, y)
        gradient.append((ahead - behind) / (2 * step))
    jacobian = np.stack(gradient, axis=-1)
    assert projector.covariance is not None
    variance = np.einsum("...ip,pq,...iq->...", jacobian, projector.covariance, jacobian)
    coarse = (np.degrees(np.sqrt(variance)) * 60).astype(np.float32)
    grid = np.stack(
        np.meshgrid(np.linspace(0, columns - 1, width), np.linspace(0, rows - 1, height)),
        axis=-1,
    )
    return sample(np.nan_to_num(coarse), grid)
