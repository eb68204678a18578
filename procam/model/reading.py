"""Readings of a hand-held colorimeter on the dome."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array
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
    """A full-panel patch of one projector, read from the dome's centre, the others shuttered.

    Attributes
    ----------
    projector : its name. patch : one of PATCHES.
    azimuth_deg, elevation_deg : direction that the meter was aimed at.
    xyz : (3,) tristimulus values [cd/m2] of the 2 degree observer; the mean of `count` readings.
    count : number of readings.
    """

    projector: str
    patch: str
    azimuth_deg: float
    elevation_deg: float
    xyz: Array
    count: int = 1

    @property
    def spot(self) -> Spot:
        """Projector and direction, which several patches share."""
        return self.projector, self.azimuth_deg, self.elevation_deg

    @property
    def direction(self) -> Array:
        """Unit direction (3,)."""
        return direction_from_angles(np.radians(self.azimuth_deg), np.radians(self.elevation_deg))

    def __str__(self) -> str:
        return f"{self.patch} of {spot_name(self.spot)}"


def spot_name(spot: Spot) -> str:
    """A spot as text, for messages.

    >>> spot_name(("south", 10.0, 42.5))
    'south at azimuth 10, elevation 42.5 deg'
    """
    name, azimuth, elevation = spot
    return f"{name} at azimuth {azimuth:g}, elevation {elevation:g} deg"
