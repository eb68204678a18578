"""Blend weights of overlapping projectors, and the common white."""

from collections.abc import Mapping

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.estimate.geometry.screen_points import round_shape, screen_points
from procam.maths.geometry.lenses import project_before_fold
from procam.maths.warp import edge_distance, sample
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import ProjectorModel
from procam.model.screen import Dome

WHITE_QUANTILE = 0.001  # instead of the minimum, to leave out a few noisy pixels


class Blender:
    """Blend weights in proportion to the distance from the border of each projector's footprint.

    They sum to 1 in linear light wherever any projector reaches.
    """

    def __init__(
        self,
        models: Mapping[str, ProjectorModel],
        surfaces: Mapping[str, ProjectorSurface],
        dome: Dome,
    ) -> None:
        self.models, self.dome = models, dome
        self.distance = {
            name: edge_distance(surface.valid) / max(models[name].size)
            for name, surface in surfaces.items()
        }

    def weights(self, direction: Image) -> dict[str, Image]:
        """Weight (H, W) of every projector in directions (H, W, 3); 0 where it does not reach."""
        distance = {name: self._distance(name, direction) for name in self.models}
        total = np.maximum(sum(distance.values()), 1e-9)
        return {name: np.asarray(d / total, np.float32) for name, d in distance.items()}

    def _distance(self, name: str, direction: Image) -> Image:
        """Distance to the border of the footprint, over the panel's larger side; 0 outside."""
        model = self.models[name]
        points = screen_points(round_shape(self.dome), direction)
        xy = project_before_fold(model.projector_from_dome.apply(points), model.lens)
        return sample(self.distance[name], xy)


def common_white(hi: FloatArray, lit: BoolArray) -> Array:
    """White (3,) that every lit direction can show, from full white `hi` (N, N, 3)."""
    return np.asarray(np.quantile(hi[lit], WHITE_QUANTILE, axis=0), float)
