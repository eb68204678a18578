"""Which projector lights what: footprints, soft edges, common white."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry.screen_points import round_shape, screen_points
from procam.maths.geometry.lenses import project
from procam.maths.warp import edge_distance, sample
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import ProjectorModel
from procam.model.screen import Dome

Image = NDArray[np.float32]
WHITE_QUANTILE = 0.001  # the smallest hi, short of a few pixels of noise


class Blender:
    """Soft edges: each projector weighs in by its distance to the border of its own footprint.

    Weights add up to 1 in linear light wherever anything is lit.
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
        """Blend weight (...) of every projector in directions (H, W, 3); 0 where it does not reach."""
        pull = {name: self._pull(name, direction) for name in self.models}
        total = np.maximum(sum(pull.values()), 1e-9)
        return {name: np.asarray(p / total, np.float32) for name, p in pull.items()}

    def _pull(self, name: str, direction: Image) -> Image:
        model = self.models[name]
        points = screen_points(round_shape(self.dome), direction)
        xy = project(model.projector_from_dome.apply(points), model.lens)
        return sample(self.distance[name], xy)


def common_white(hi: NDArray[np.floating], lit: NDArray[np.bool_]) -> NDArray[np.float64]:
    """W (3,): the white that every lit direction can show, one number per channel."""
    return np.asarray(np.quantile(hi[lit], WHITE_QUANTILE, axis=0), float)
