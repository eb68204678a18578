"""Cameras and projectors as the solver knows them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.maths.lenses import Lens
from procam.maths.pose import Pose

__all__ = ["CameraModel", "Fiducial", "Lens", "Pose", "ProjectorModel", "Sensor"]


@dataclass(frozen=True, slots=True)
class Sensor:
    """How a camera turns light into counts.

    Attributes
    ----------
    bits : depth of the raw values [bit].
    black_level : counts without light [DN].
    vignetting : even polynomial of the angle off the optical axis, 1 + v1 theta^2 + v2 theta^4 + ...
    glare, glare_sigma : share of the frame's mean radiance that veils every pixel [-].
    """

    bits: int
    black_level: float
    vignetting: tuple[float, ...] = ()
    glare: float = 0.0
    glare_sigma: float = 0.0

    @property
    def full_scale(self) -> float:
        """Counts between black and saturation [DN]."""
        return 2**self.bits - 1 - self.black_level


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A camera: size (width, height) [px], lens, sensor and, once solved, where it stands."""

    name: str
    size: tuple[int, int]
    lens: Lens
    sensor: Sensor
    camera_from_dome: Pose | None = None


@dataclass(frozen=True, slots=True)
class ProjectorModel:
    """A projector: size (width, height) [px], lens, pose and the covariance of its parameters.

    `covariance` (13, 13) is ordered: rotation [rad], translation [m], focal x, y, centre x, y [px],
    k1, k2, k3 [-].
    """

    name: str
    size: tuple[int, int]
    lens: Lens
    projector_from_dome: Pose
    covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class Fiducial:
    """A mark on the dome whose place is known and which a camera sees.

    `direction` (3,) is a unit vector from the dome's centre, `pixel` (2,) where `camera` sees it.
    """

    name: str
    direction: NDArray[np.float64]
    sigma: float
    camera: str
    pixel: NDArray[np.float64]
