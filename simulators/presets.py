"""The simulated venues, in one table. Variations are amplitudes, not peak to peak."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypedDict, Unpack

from simulators.builds import CameraFlaws, Features

PresetName = Literal["ideal", "standard", "realistic", "faulty"]
NO_FLAWS = CameraFlaws()
EXPOSURE_S = 0.13  # white of one projector stays just below saturation


class Overrides(TypedDict, total=False):
    """Keys of [simulated] that replace a preset's own values; None keeps them.

    Attributes
    ----------
    albedo : mean reflectance of the dome, 0..0.95; it changes the strength of inter-reflection and
        nothing else. The projectors are brighter for darker paint, so that light after its first
        bounce keeps its level and exposures stay valid. At 0 there is no inter-reflection at all
        (dome and deck), and the first bounce has the preset's albedo: an ideal measurement, not a
        black dome.
    snr : signal to noise of the darkest lit pixel: (white - black) over the sigma of white in one
        frame, where one projector alone shows full white in the green band at `white_exposure_s`.
        Darkest: the 0.5 percentile over lit pixels clear of the picture's border, of the
        projector where it is lowest. Shot and read noise keep their ratio; the camera has its 12
        bits, also where the preset's has no noise.
    defocus_px : Gaussian sigma of the projectors' lenses [px]; 0 is sharp.
    gamma_left : factor on the projectors' gamma; light linearised for a factor of 1 has this error.
    """

    albedo: float | None
    snr: float | None
    defocus_px: float | None
    gamma_left: float | None


@dataclass(frozen=True, slots=True)
class Preset:
    """Geometry and imperfections of a venue.

    Attributes
    ----------
    radius_m, half_angle_deg, tilt_deg : the cap.
    strip_share : share of the cap beyond the projectors' blackout plates: it reflects, unlit.
    ovality, panel_step_m : radial harmonics l = 2..4 relative to the radius; panel offsets [m].
    floor_albedo, pod : the deck under the dome, and a ball-shaped instrument on it.
    deck_drop_m, wall_albedo : how far the deck is below the dome's lowest point, and the wall between.
    albedo, albedo_smooth, seam, dust : mean reflectance, relative slow variation, relative loss
        along panel seams, relative slow drift from front to back.
    gloss : share of the reflected light that leaves in a lobe round the mirror direction.
    glare, glare_known : share of a camera frame's mean that veils every pixel; whether the
        venue file has it.
    white_snr : signal to noise at white level; None for a camera without noise or quantisation.
    darkest_snr : likewise for the darkest lit pixel (`Overrides.snr`); it overrides `white_snr`.
    drift : relative change of the camera's gain in 600 s.
    faults : named faults (simulators.faults).
    brightness : median irradiance of a projector's full white [camera full scale per second].
    bounces : False for a room without inter-reflection.
    defocus_px, gamma_left : of all projectors; None leaves the defocus they were built with.
    features : menu features of single projectors, by name.
    rig_seed, rig_spread : what the projectors' places and lenses are drawn with, and how widely.
    camera_shift : of the cameras from their usual places [radii of the dome].
    flaws : of the cameras.
    dirt : (loss, azimuth [deg]) each: relative loss of albedo at the side of the azimuth, linear to 0
        at the other side.
    stains : (loss, azimuth [deg]) each: relative loss of albedo at the centre of a Gaussian patch.
    ambient : radiance of the dome by lamps left on in the room, relative to the median direct
        radiance of one projector's white, which is `brightness` times `albedo`.
    """

    radius_m: float = 6.0
    half_angle_deg: float = 90.0
    tilt_deg: float = 10.0
    strip_share: float = 0.10
    ovality: float = 0.0
    panel_step_m: float = 0.0
    floor_albedo: float = 0.08
    pod: bool = False
    deck_drop_m: float = 0.0
    wall_albedo: float = 0.0
    albedo: float = 0.5
    albedo_smooth: float = 0.05
    seam: float = 0.07
    dust: float = 0.0
    gloss: float = 0.0
    glare: float = 0.003
    glare_known: bool = True
    white_snr: float | None = 100.0
    drift: float = 0.0
    faults: tuple[str, ...] = ()
    brightness: float = 6.0
    bounces: bool = True
    darkest_snr: float | None = None
    defocus_px: float | None = None
    gamma_left: float = 1.0
    features: tuple[tuple[str, Features], ...] = ()
    rig_seed: int = 8611005
    rig_spread: float = 1.0
    camera_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    flaws: CameraFlaws = NO_FLAWS
    dirt: tuple[tuple[float, float], ...] = ()
    stains: tuple[tuple[float, float], ...] = ()
    ambient: float = 0.0

    @property
    def noisy(self) -> bool:
        """Whether the cameras have noise and few bits."""
        return self.white_snr is not None or self.darkest_snr is not None

    def altered(self, **overrides: Unpack[Overrides]) -> "Preset":
        """The preset with the overrides that are not None."""
        albedo, gamma_left = overrides.get("albedo"), overrides.get("gamma_left")
        snr, defocus_px = overrides.get("snr"), overrides.get("defocus_px")
        return replace(
            self if albedo is None else self._painted(albedo),
            darkest_snr=self.darkest_snr if snr is None else snr,
            defocus_px=self.defocus_px if defocus_px is None else defocus_px,
            gamma_left=self.gamma_left if gamma_left is None else gamma_left,
        )

    def with_features(self, features: Mapping[str, Mapping[str, float]]) -> "Preset":
        """The preset with features switched on: sizes by name (`Features.named`), by projector."""
        named = tuple((projector, Features.named(sizes)) for projector, sizes in features.items())
        return replace(self, features=named)

    def _painted(self, albedo: float) -> "Preset":
        if albedo == 0:
            return replace(self, bounces=False)
        brightness = self.brightness * self.albedo / albedo
        return replace(self, albedo=albedo, brightness=brightness, bounces=True)


def white_exposure_s(preset: Preset) -> float:
    """Exposure [s] that keeps white of one projector, and its noise, just below saturation.

    Shorter than `EXPOSURE_S` where much scattered light or much noise comes on top.
    """
    bouncing = preset.albedo / (1 - preset.albedo / 2) if preset.bounces else 0.0
    peak = 0.824 + 0.111 * bouncing  # brightest pixel at EXPOSURE_S, a fit to renders
    noise = 1.5 / preset.darkest_snr if preset.darkest_snr else 0.0  # three sigma of it
    return round(EXPOSURE_S * min(1.0, 0.94 / (peak * (1 + noise))), 4)


STANDARD = Preset()
IDEAL = Preset(
    strip_share=0.05, floor_albedo=0.0, albedo_smooth=0.0, seam=0.0, glare=0.0, white_snr=None
)
REALISTIC = Preset(
    ovality=0.001,
    panel_step_m=0.002,
    floor_albedo=0.12,
    pod=True,
    dust=0.02,
    gloss=0.03,
    glare=0.01,
    glare_known=False,
    drift=0.003,
)
FAULTY = replace(REALISTIC, faults=("stale-frame", "unplugged-serial"))

PRESETS: dict[PresetName, Preset] = {
    "ideal": IDEAL,
    "standard": STANDARD,
    "realistic": REALISTIC,
    "faulty": FAULTY,
}
