"""One photograph as the camera delivers it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

PixelFormat = Literal["mono", "rgb"]


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """Settings of a camera for one photograph.

    Attributes
    ----------
    exposure_s : shutter time [s].
    pixel_format : "rgb" for three channels, "mono" for the green one alone (a third of the data).
    gain : analogue gain [-].
    """

    exposure_s: float
    pixel_format: PixelFormat = "rgb"
    gain: float = 1.0


@dataclass(frozen=True, slots=True)
class Frame:
    """Raw camera values of one exposure.

    Attributes
    ----------
    counts : (H, W) or (H, W, 3) uint16, raw camera values [DN].
    settings : the settings in force, which may differ from those requested.
    started_s, ended_s : when the shutter opened and closed, on the rig's clock [s].
    """

    counts: NDArray[np.uint16]
    settings: CameraSettings
    started_s: float
    ended_s: float
