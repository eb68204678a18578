"""Where projector pixels land, how large they are, how sure that is, and which of them are lit."""

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry import GeometrySolution
from procam.estimate.landing import measure_landing
from procam.estimate.shapes import screen_points
from procam.estimate.transport import Light
from procam.maths.areas import panel_solid_angles
from procam.maths.lenses import project
from procam.maths.warp import sample
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import CameraModel
from procam.model.screen import Dome

Array = NDArray[np.float64]
LIT_HALF = 0.5  # a border pixel counts when half of its light arrives


def project_surface(
    solution: GeometrySolution, name: str, dome: Dome, light: Light
) -> ProjectorSurface:
    """The surface of projector `name`; `light` tells which pixels really arrive on the screen.

    Directions are those that cameras measured, as far as they differ from the model by more than
    noise; the model's elsewhere, with what is known of its error nearby.
    """
    landing = measure_landing(solution, name)
    width, height = landing.size
    direction = landing.directions(np.arange(width), np.arange(height))
    on_screen = direction[..., 2] >= np.cos(dome.half_angle)
    measured = np.where(on_screen, lit_share(solution, direction, light), 0)
    return ProjectorSurface(
        direction.astype(np.float32),
        panel_solid_angles(landing.size, landing.directions).astype(np.float32),
        measured > LIT_HALF,
        measured.astype(np.float32),
        landing.sigma_arcmin(np.arange(width), np.arange(height)),
    )


def camera_pixels(solution: GeometrySolution, direction: NDArray[np.floating]) -> Array:
    """Pixel (..., 2) of the main camera that sees the screen in directions (..., 3)."""
    camera: CameraModel = solution.camera
    assert camera.camera_from_dome is not None
    points = screen_points(solution.rig.shape, direction)
    return project(camera.camera_from_dome.apply(points), camera.lens)


def lit_share(
    solution: GeometrySolution, direction: NDArray[np.floating], light: Light
) -> NDArray[np.float32]:
    """Share 0..1 (...) of the light expected in directions (..., 3) that the camera really saw."""
    xy = camera_pixels(solution, direction)
    seen, expected = sample(light.direct[..., 1], xy), sample(light.extended[..., 1], xy)
    floor = 0.02 * float(np.percentile(light.extended[..., 1], 99))
    share = np.where(expected > floor, seen / np.maximum(expected, floor), 0)
    return np.asarray(np.clip(share, 0, 1), np.float32)
