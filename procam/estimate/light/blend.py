"""Blend weights of overlapping projectors, and the common white."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.geometry.screen_points import panel_pixels, screen_points
from procam.maths.warp import edge_distance, sample
from procam.model.calibration import ProjectorCalibration
from procam.model.screen import Screen

WHITE_QUANTILE = 0.001  # instead of the minimum, to leave out a few noisy pixels


class Blender:
    """Blend weights in proportion to the distance from the border of each projector's footprint.

    They sum to 1 in linear light wherever any projector reaches.
    """

    def __init__(self, projectors: Mapping[str, ProjectorCalibration], screen: Screen) -> None:
        self._projectors, self._shape = projectors, screen.shape
        self._distance = {
            name: edge_distance(each.surface.valid) / max(each.model.size)
            for name, each in projectors.items()
        }

    def place(self, name: str, direction: Image) -> Image:
        """Panel pixel (H, W, 2) of a projector that lights directions (H, W, 3); NaN if it cannot."""
        points = screen_points(self._shape, direction)
        place = panel_pixels(self._shape, self._projectors[name].model, points)
        return np.asarray(place, np.float32)

    def weights(self, direction: Image) -> dict[str, Image]:
        """Weight (H, W) of every projector in directions (H, W, 3); 0 where it does not reach."""
        distance = {
            name: sample(each, self.place(name, direction))  # over the panel's larger side
            for name, each in self._distance.items()
        }
        total = np.maximum(sum(distance.values()), 1e-9)
        return {name: np.asarray(d / total, np.float32) for name, d in distance.items()}

    def blended(self) -> dict[str, ProjectorCalibration]:
        """The projectors with their weights at each pixel."""
        return {name: self._blended(name, each) for name, each in self._projectors.items()}

    def _blended(self, name: str, projector: ProjectorCalibration) -> ProjectorCalibration:
        surface = projector.surface
        weight = self.weights(np.nan_to_num(surface.direction))[name]
        return replace(projector, blend=(weight * surface.valid).astype(np.float32))


def common_white(hi: FloatArray, lit: BoolArray) -> Array:
    """White (3,) that every lit direction can show, from full white `hi` (N, N, 3)."""
    return np.asarray(np.quantile(hi[lit], WHITE_QUANTILE, axis=0), float)
