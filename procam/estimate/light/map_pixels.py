"""The pixels of a calibration's maps: what they see, what lights them, and how much each counts."""

from collections.abc import Mapping

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.light.calibrated_projector import Placed
from procam.estimate.light.full_white import FullWhite, black_light
from procam.estimate.light.measurement import ProjectorMeasurement
from procam.estimate.light.scatter_kernel import CELLS
from procam.model.calibration import ProjectorCalibration


class MapPixels:
    """Pixels (H, W) of the screen's canvas.

    Attributes
    ----------
    inside : (H, W) on the screen. where : (H, W, 2) pixel of the camera that sees them. white : of all
        projectors. coverage : (H, W) share of the pixel that is lit. weight : (H, W) of that part.
    inside_weight : of all pixels on the screen.
    """

    def __init__(
        self, placed: Placed, projectors: Mapping[str, ProjectorCalibration], size: int
    ) -> None:
        self._placed, self._size = placed, size
        screen = placed.screen
        self.white = FullWhite(projectors, screen, size)
        direction, self.inside = screen.canvas.directions(size)
        self.where = placed.view.camera_pixels(screen, direction)
        self.coverage, weight = self.white.coverage, screen.canvas.weights(size)
        self.weight, self.inside_weight = weight * self.coverage, float(weight[self.inside].sum())

    def mean(self, values: Image) -> Array:
        """Mean (C,) over the lit part."""
        return np.asarray(np.tensordot(self.weight, values, 2) / self.weight.sum())

    def flux_in_cells(self, hi: Array) -> Array:
        """Flux (N, C) of full white in the cells of the scatter kernel's fit [rel sr]."""
        fine = self._size // CELLS
        light = hi * self.weight[..., None]
        return np.asarray(
            light.reshape(CELLS, fine, CELLS, fine, -1).sum(axis=(1, 3)).reshape(CELLS**2, -1)
        )

    def black_level(
        self, measured: Mapping[str, ProjectorMeasurement], to_relative: Array
    ) -> Image:
        """Direct black light (H, W, 3) of all projectors together, smoothed [rel]."""
        rest = self._placed.view, self._placed.screen, to_relative, self._size
        total = sum(black_light(each, *rest) for each in measured.values())
        return np.asarray(np.maximum(total, 0) * self.coverage[..., None], np.float32)
