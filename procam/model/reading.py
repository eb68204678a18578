"""What a hand meter reads off the dome."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.maths.geometry.sphere import direction_from_angles

# drive of red, green and blue that fills the panel
PATCHES = {
    "red": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "blue": (0.0, 0.0, 1.0),
    "white": (1.0, 1.0, 1.0),
    "black": (0.0, 0.0, 0.0),
}
BLACK = "black"
Spot = tuple[str, float, float]  # projector, azimuth and elevation [deg]


@dataclass(frozen=True, slots=True)
class MeterReading:
    """A full-panel patch of one projector, read from the dome's middle, the others shuttered.

    Attributes
    ----------
    projector : its name. patch : one of PATCHES.
    azimuth_deg, elevation_deg : where on the dome the meter looked.
    xyz : (3,) tristimulus values [cd/m2] of the 2 degree observer; the mean where it was read often.
    count : how many readings are in it.
    """

    projector: str
    patch: str
    azimuth_deg: float
    elevation_deg: float
    xyz: NDArray[np.float64]
    count: int = 1

    @property
    def spot(self) -> Spot:
        """Projector and place, which several patches share."""
        return self.projector, self.azimuth_deg, self.elevation_deg

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit direction (3,) of the place."""
        return direction_from_angles(np.radians(self.azimuth_deg), np.radians(self.elevation_deg))

    def __str__(self) -> str:
        return f"{self.patch} of {spot_name(self.spot)}"


def spot_name(spot: Spot) -> str:
    """A spot in words.

    >>> spot_name(("south", 10.0, 42.5))
    'south at azimuth 10, elevation 42.5 deg'
    """
    name, azimuth, elevation = spot
    return f"{name} at azimuth {azimuth:g}, elevation {elevation:g} deg"
