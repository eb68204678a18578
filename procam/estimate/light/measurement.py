"""The light of one projector as a camera measured it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.light.projector_response import ColourFit
from procam.estimate.light.scatter_kernel import ScatterSample
from procam.estimate.light.separation import SeparatedLight
from procam.model.photometry import ResponseCurve
from procam.model.provenance import Note


@dataclass(frozen=True, slots=True)
class ProjectorMeasurement:
    """Light of one projector in camera channels.

    Attributes
    ----------
    light : direct and scattered light of its white.
    black : (H, W, 3) radiance of its black picture, scattered light included.
    colour, response : fitted to its pictures of primaries and of levels.
    scatter_samples : of its white, then of its other pictures.
    exponent : as in `Photometry`. notes : for the report. moved_px : of the camera's picture meanwhile.
    """

    light: SeparatedLight
    black: Image
    colour: ColourFit
    response: ResponseCurve
    scatter_samples: Sequence[ScatterSample] = ()
    exponent: Image | None = None
    notes: Sequence[Note] = ()
    moved_px: float = 0.0

    @property
    def white(self) -> Array:
        """Mean radiance (3,) of its white, of which the colour mix has the shares."""
        return np.asarray(self.light.direct[self.light.lit].mean(axis=0, dtype=float))


def direct_black(measured: ProjectorMeasurement) -> Image:
    """Direct radiance (H, W, 3) of a projector's black, 0 where it does not light.

    A projector's black is distributed like its white, so its share of scattered light is the same.
    """
    light = measured.light
    both = np.maximum(light.direct + light.scattered, 1e-9)
    share = np.where(light.lit[..., None], light.direct / both, 0)
    return np.asarray(np.nan_to_num(measured.black) * share, np.float32)
