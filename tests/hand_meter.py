"""A hand meter in a dome of known light; every reading is summed over pixels."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import angles_from_direction, master_directions
from procam.model.calibration import Calibration
from procam.model.reading import PATCHES, MeterReading

# P3's primaries mixed to D65, as published (SMPTE EG 432-1), at 11 cd/m2
P3 = np.array(
    [
        [0.48657095, 0.26566769, 0.19821729],
        [0.22897456, 0.69173852, 0.07928691],
        [0.0, 0.04511338, 1.04394437],
    ]
)
XYZ_FROM_CONTENT = 11.0 * P3
BLACK_PER_WHITE = 0.004
FEEDBACK = (0.3, 0.33, 0.4)
LIT_SR = 2 * np.pi * (1 - np.sin(np.radians(10.0)))
COLOUR = np.array([1.0, 1.1, 0.9])
# row and column of panel pixels that the camera sees
MIDDLE, LEFT, RIGHT = (15, 24), (15, 10), (10, 36)
EVERY = tuple(PATCHES)


def known_dome(make: Callable[..., Calibration], black: float = BLACK_PER_WHITE) -> Calibration:
    """The usual two projectors; their black has the colour and shape of their white."""
    calibration = make(size=512, feedback=FEEDBACK)
    direction, inside = master_directions(512)
    reach = np.zeros((512, 512))
    for projector in calibration.projectors.values():
        points = calibration.screen.radius_m * direction
        model = projector.model
        xy = project(model.projector_from_dome.apply(points), model.lens)
        width, height = model.size
        on_panel = (xy > -0.5).all(-1) & (xy[..., 0] < width - 0.5) & (xy[..., 1] < height - 0.5)
        reach += on_panel & inside & (direction[..., 2] > np.sin(np.radians(10.0)))
    white = (1.2 + 0.3 * direction[..., 0]) * reach
    lo = (black * white[..., None] * COLOUR).astype(np.float32)
    return replace(calibration, maps=replace(calibration.maps, lo=lo))


@dataclass(frozen=True)
class Meter:
    """Readings of the total light of a dome.

    `matrix` is the true XYZ of content; `shape` the relative light scattered from directions (N, 3) to a
    direction (3,), 1 for uniform; `room` is the XYZ of other light.
    """

    calibration: Calibration
    matrix: np.ndarray = field(default_factory=lambda: XYZ_FROM_CONTENT)
    shape: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda place, all_of: np.ones(
        len(all_of)
    )
    black: float = BLACK_PER_WHITE
    room: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def read(self, name: str, patch: str, pixel: tuple[int, int] = MIDDLE) -> MeterReading:
        """One patch at the point that a panel pixel lights."""
        projector = self.calibration.projectors[name]
        surface, light = projector.surface, projector.photometry
        drive = light.colour_mix @ np.array(PATCHES[patch]) + self.black
        direct = light.gain.astype(float) * drive
        place = surface.direction[pixel].astype(float)
        patches = surface.direction.reshape(-1, 3).astype(float)
        weight = surface.solid_angle_sr.ravel() * self.shape(place, patches)
        flux = sum(a * b for a, b in zip(weight, direct.reshape(-1, 3), strict=True))
        paint = 1 + 0.03 * place[0] - 0.02 * place[1]
        scattered = paint * np.array(FEEDBACK) / LIT_SR * flux
        azimuth, elevation = np.degrees(angles_from_direction(place))
        xyz = self.matrix @ (direct[pixel] + scattered) + np.array(self.room)
        return MeterReading(name, patch, float(azimuth), float(elevation), xyz)

    def read_all(
        self,
        *spots: tuple[str, tuple[int, int]],
        patches: tuple[str, ...] = ("red", "green", "blue", "white"),
    ) -> list[MeterReading]:
        """Patches at several points."""
        return [self.read(name, patch, pixel) for name, pixel in spots for patch in patches]


def with_noise(readings: list[MeterReading], rng: np.random.Generator) -> list[MeterReading]:
    """Readings with the errors of a good meter: 2 % of Y, 0.002 of x and y."""
    noisy = []
    for reading in readings:
        x, y = reading.xyz[:2] / reading.xyz.sum() + 0.002 * rng.normal(size=2)
        luminance = reading.xyz[1] * (1 + 0.02 * rng.normal())
        xyz = luminance / y * np.array([x, y, 1 - x - y])
        noisy.append(replace(reading, xyz=xyz))
    return noisy


def as_csv(readings: list[MeterReading]) -> str:
    """The file of a person with a meter, with all digits."""
    lines = ["projector,patch,azimuth_deg,elevation_deg,X,Y,Z"]
    for r in readings:
        numbers = ",".join(repr(float(v)) for v in (r.azimuth_deg, r.elevation_deg, *r.xyz))
        lines.append(f"{r.projector},{r.patch},{numbers}")
    return "\n".join([*lines, ""])
