"""The simulated venues: one table, amplitudes rather than peak to peak (design.md s.1)."""

from dataclasses import dataclass, replace
from typing import Literal

PresetName = Literal["ideal", "standard", "realistic", "faulty"]


@dataclass(frozen=True, slots=True)
class Preset:
    """What is wrong with a venue.

    Attributes
    ----------
    radius_m, half_angle_deg, tilt_deg : the cap.
    strip_share : share of the cap beyond the projectors' blackout plates: it reflects, unlit.
    ovality, panel_step_m : radial harmonics l = 2..4 relative to the radius; panel offsets [m].
    floor_albedo, pod : the deck under the dome, and a ball-shaped instrument on it.
    albedo, albedo_smooth, seam, dust : mean reflectance, relative slow variation, relative loss
        along panel seams, relative slow drift from front to back.
    gloss : share of the reflected light that leaves in a lobe round the mirror direction.
    glare, glare_known : share of a camera frame's mean that veils every pixel; whether the
        venue file tells.
    white_snr : signal to noise at white level; None for a camera without noise or quantisation.
    drift : relative change of the camera's gain in 600 s.
    faults : named faults (simulators.faults).
    """

    radius_m: float = 6.0
    half_angle_deg: float = 90.0
    tilt_deg: float = 10.0
    strip_share: float = 0.10
    ovality: float = 0.0
    panel_step_m: float = 0.0
    floor_albedo: float = 0.08
    pod: bool = False
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


STANDARD = Preset()
IDEAL = Preset(
    strip_share=0.05,
    floor_albedo=0.0,
    albedo_smooth=0.0,
    seam=0.0,
    glare=0.0,
    white_snr=None,
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
