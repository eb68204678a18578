"""The screen: what the light lands on."""

from dataclasses import dataclass

from procam.errors import UnitError


@dataclass(frozen=True, slots=True)
class Dome:
    """A spherical cap round the dome frame's origin, its pole on z.

    Attributes
    ----------
    radius_m : sphere radius [m].
    half_angle : angle from the pole to the rim of all that is screen, lit or not [rad].
    tilt : how far the pole leans towards the front, off gravity's vertical [rad].
    floor_albedo, floor_albedo_sigma : what is known of the deck under the dome, diffuse
        reflectance [-]; it enters the albedo only, never the compensation.
    """

    radius_m: float
    half_angle: float
    tilt: float = 0.0
    floor_albedo: float = 0.0
    floor_albedo_sigma: float = 0.0

    def __post_init__(self) -> None:
        if not self.radius_m > 0:  # also refuses NaN
            raise UnitError(f"radius_m: got {self.radius_m}, expected more than 0 metres")
        if not 0 < self.half_angle < 3.1416:
            raise UnitError(f"half_angle: got {self.half_angle} rad, expected between 0 and pi")
