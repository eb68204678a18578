"""What projectors at full white, and at black, put on the pixels of a canvas."""

from collections.abc import Mapping

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.blend import Blender
from procam.estimate.light.measurement import ProjectorMeasurement, direct_black
from procam.estimate.light.scatter_kernel import BLACK_BLUR_PX
from procam.maths.warp import blur, blur_within, sample
from procam.model.calibration import ProjectorCalibration
from procam.model.screen import Screen

BORDER_PX = 2.0  # Gaussian that continues a gain beyond its border


class FullWhite:
    """Full white of projectors that are blended.

    Attributes
    ----------
    weights : (N, N) of each projector. coverage : (N, N) share of the pixel that some projector lights.
    light : (N, N, 3) direct light, in the unit of the gains.
    """

    def __init__(
        self, projectors: Mapping[str, ProjectorCalibration], screen: Screen, size: int
    ) -> None:
        exact, inside = screen.canvas.directions(size)
        direction = exact.astype(np.float32)
        blender = Blender(projectors, screen)
        self.weights = blender.weights(direction)
        share, self.light = np.zeros(inside.shape), np.zeros((*inside.shape, 3))
        for name, each in projectors.items():
            place, weight = blender.place(name, direction), self.weights[name]
            np.maximum(share, sample(each.surface.measured, place), out=share)
            self.light += weight[..., None] * sample(_continued(each), place)
        # a projector's blur lights directions that none of its pixels reaches
        reached = np.sum(list(self.weights.values()), axis=0) > 0
        # a ramp about one half, insensitive to noise near 0 and 1
        ramp = np.clip(2 * share - 0.5, 0, 1) * (inside & reached)
        self.coverage = ramp.astype(np.float32)


def _continued(projector: ProjectorCalibration) -> Image:
    """Gain (H, W, 3), continued beyond the border of the footprint, where samples would mix it with none."""
    gain, valid = projector.photometry.gain, projector.surface.valid
    return np.where(valid[..., None], gain, blur_within(gain, valid, BORDER_PX))


def black_light(
    measured: ProjectorMeasurement,
    view: ScreenView,
    screen: Screen,
    content_from_camera: Array,
    size: int,
) -> Image:
    """Direct light (size, size, 3) of one projector's black, smoothed; noise may make it negative."""
    smooth = blur(direct_black(measured), BLACK_BLUR_PX) @ content_from_camera.T.astype(np.float32)
    return sample(smooth, view.camera_pixels(screen, screen.canvas.directions(size)[0]))
