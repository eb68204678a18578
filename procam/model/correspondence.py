"""Which projector pixel a camera pixel sees, and what that means on the dome."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class CorrespondenceMap:
    """Per camera pixel: `projector_xy` (H, W, 2) [px], NaN where not `valid`; `sigma_px` (H, W)."""

    projector_xy: Map
    sigma_px: Map
    valid: Mask


@dataclass(frozen=True, slots=True)
class ProjectorSurface:
    """Per projector pixel: where it lands on the dome and how large it is.

    Attributes
    ----------
    direction : (H, W, 3) unit vectors from the dome's centre; NaN where the ray misses the screen.
    solid_angle_sr : (H, W) seen from the dome's centre [sr].
    valid : (H, W) light of this pixel arrives on the screen.
    measured : (H, W) share of the pixel that a camera saw lit, 0..1.
    sigma_arcmin : (H, W) standard error of the direction [arcmin].
    """

    direction: Map
    solid_angle_sr: Map
    valid: Mask
    measured: Map
    sigma_arcmin: Map
