"""Cameras, projectors, fiducials and distances, as the geometric solver takes them."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from procam.arrays import Array
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose

TagFamily = Literal["36h11", "25h9", "16h5"]
USUAL_FAMILY: TagFamily = "36h11"
TAG_COUNTS: dict[TagFamily, int] = {"36h11": 587, "25h9": 35, "16h5": 30}


@dataclass(frozen=True, slots=True)
class Sensor:
    """Radiometric model of a camera.

    Attributes
    ----------
    bits : depth of the raw counts [bit].
    black_level : counts without light [DN].
    vignetting : even polynomial of the angle off the optical axis, 1 + v1 theta^2 + v2 theta^4 + ...
    glare, glare_sigma : share of the picture's mean radiance that veiling glare adds to every pixel,
        and its standard error [-] (docs/theory/photometry.md, R1).
    near_glare : the part of the glare that stays near its light, solved from the pictures of a session, as
        Gaussians: share of the light, and standard deviation [of the picture's shorter side], of each.
    """

    bits: int
    black_level: float
    vignetting: tuple[float, ...] = ()
    glare: float = 0.0
    glare_sigma: float = 0.0
    near_glare: tuple[tuple[float, float], ...] = ()

    @property
    def near_share(self) -> float:
        """Share of the light in the near part of the veil."""
        return sum(share for share, _ in self.near_glare)

    @property
    def full_scale(self) -> float:
        """Counts between black and saturation [DN]."""
        return 2**self.bits - 1 - self.black_level


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A camera: size (width, height) [px], lens, sensor and, once solved, its pose.

    `pupil` (2,): the entrance pupil moves along the optical axis with the angle theta off it, by
    pupil[0] theta^2 + pupil[1] theta^4 [m]; millimetres in wide fisheyes.
    """

    name: str
    size: tuple[int, int]
    lens: Lens
    sensor: Sensor
    camera_from_dome: Pose | None = None
    pupil: Array = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True, slots=True)
class ProjectorModel:
    """A projector: size (width, height) [px], lens, pose and the covariance of its parameters.

    `covariance` (P, P) is ordered: rotation [rad] and shift [m] in its own frame, focal x, y, centre
    x, y [px], distortion [-].
    """

    name: str
    size: tuple[int, int]
    lens: Lens
    projector_from_dome: Pose
    covariance: Array | None = None


@dataclass(frozen=True, slots=True)
class Fiducial:
    """A point of known direction on the dome that a camera sees or a projector shows.

    `azimuth`, `elevation` [rad] from the dome's centre with standard error `sigma` [rad]; None where
    not known: a springline mark has an elevation alone. `device` is the camera that sees it at `pixel`
    (2,), or the projector that shows it there. `camera_sigma` [rad] is the part of `sigma` that is an error
    of the pixel, as an angle about the camera.
    """

    name: str
    azimuth: float | None
    elevation: float | None
    sigma: float
    device: str
    pixel: Array
    camera_sigma: float = 0.0


@dataclass(frozen=True, slots=True)
class AprilTag:
    """A printed AprilTag on the dome, which is detected in photographs.

    `family` and `number` identify it; `azimuth`, `elevation` and `sigma` [rad] are those of its
    centre, as in `Fiducial`.
    """

    family: TagFamily
    number: int
    azimuth: float | None
    elevation: float | None
    sigma: float

    @property
    def name(self) -> str:
        """Its name in messages, and that of the fiducial made from it."""
        return tag_name(self.family, self.number)


def tag_name(family: TagFamily, number: int) -> str:
    """Name of a tag in messages.

    >>> tag_name("36h11", 7), tag_name("25h9", 7)
    ('tag 7', 'tag 7 of 25h9')
    """
    return f"tag {number}" if family == USUAL_FAMILY else f"tag {number} of {family}"


@dataclass(frozen=True, slots=True)
class Distance:
    """A distance [m] measured between two cameras, projectors or fiducials `a` and `b`."""

    a: str
    b: str
    metres: float
    sigma_m: float
