"""Where projector pixels land, how large they are, how sure that is, and which of them are lit."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry.pixel_directions import PixelDirections, fit_pixel_directions
from procam.estimate.geometry.screen_points import screen_points
from procam.estimate.geometry.solve import GeometrySolution
from procam.estimate.light.separation import SeparatedLight
from procam.maths.geometry.areas import PanelField, panel_solid_angles
from procam.maths.geometry.lenses import project
from procam.maths.geometry.local_shift import LocalShift
from procam.maths.warp import sample
from procam.model.correspondence import ProjectorSurface
from procam.model.mask import Nudge
from procam.model.optics import CameraModel
from procam.model.screen import Dome

Array = NDArray[np.float64]
LIT_HALF = 0.5  # a border pixel counts when half of its light arrives


def project_surface(
    solution: GeometrySolution,
    name: str,
    dome: Dome,
    light: SeparatedLight,
    nudges: Sequence[Nudge] = (),
) -> ProjectorSurface:
    """The surface of projector `name`; `light` tells which pixels really arrive on the screen.

    Directions are those that cameras measured, as far as they differ from the model by more than
    noise; the model's elsewhere, with what is known of its error nearby. Where a person nudged the
    picture, they are those that it was moved away from. Nudges move no light and tell nothing of
    errors: what is lit, and the standard error, stay as measured.
    """
    landing = fit_pixel_directions(solution, name)
    own = [nudge for nudge in nudges if nudge.projector == name]
    shipped = _nudged(landing, own) if own else landing.directions
    x, y = (np.arange(n, dtype=float) for n in landing.size)
    seen = landing.directions(x, y)
    direction = shipped(x, y) if own else seen
    on_screen = direction[..., 2] >= np.cos(dome.half_angle)
    measured = np.where(on_screen, lit_share(solution, seen, light), 0)
    return ProjectorSurface(
        direction.astype(np.float32),
        panel_solid_angles(landing.size, shipped).astype(np.float32),
        measured > LIT_HALF,
        measured.astype(np.float32),
        landing.sigma_arcmin(x, y),
    )


def _nudged(landing: PixelDirections, nudges: Sequence[Nudge]) -> PanelField:
    """Directions of the panel's points (x, y) [px] after a person has moved the picture."""
    shift = LocalShift.on_panel(
        landing.size,
        np.array([nudge.pixel for nudge in nudges]),
        np.array([nudge.shift_px for nudge in nudges]),
    )

    def directions(x: Array, y: Array) -> Array:
        places = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
        return landing.at(places - shift.at(places))

    return directions


def camera_pixels(solution: GeometrySolution, direction: NDArray[np.floating]) -> Array:
    """Pixel (..., 2) of the main camera that sees the screen in directions (..., 3)."""
    camera: CameraModel = solution.camera
    assert camera.camera_from_dome is not None
    points = screen_points(solution.rig.shape, direction)
    return project(camera.camera_from_dome.apply(points), camera.lens)


def lit_share(
    solution: GeometrySolution, direction: NDArray[np.floating], light: SeparatedLight
) -> NDArray[np.float32]:
    """Share 0..1 (...) of the light expected in directions (..., 3) that the camera really saw."""
    xy = camera_pixels(solution, direction)
    seen, expected = sample(light.direct[..., 1], xy), sample(light.extended[..., 1], xy)
    floor = 0.02 * float(np.percentile(light.extended[..., 1], 99))
    share = np.where(expected > floor, seen / np.maximum(expected, floor), 0)
    return np.asarray(np.clip(share, 0, 1), np.float32)
