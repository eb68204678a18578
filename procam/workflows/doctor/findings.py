"""The faults of a venue's devices, one per line, and the measurements behind them.

`Diagnosis` collects both; the `judge_` functions compare measurements with thresholds. The file is
longer than 300 lines because one place holds every threshold of `procam doctor` beside its message.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

from procam.estimate.camera.exposure import MAX_EXPOSURES, TARGET_SNR, ExposurePlan
from procam.estimate.projector_tests.analysis import Effect
from procam.model.optics import Sensor


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong: `device` as in "camera zenith", a short `kind`, and a sentence."""

    device: str
    kind: str
    text: str

    def __str__(self) -> str:
        # errors of devices begin with its name already
        return self.text if self.text.startswith(self.device) else f"{self.device}: {self.text}"

    @classmethod
    def of(cls, device: str, kind: str, found: str, needed: str, advice: str) -> "Finding":
        """What was found, what is needed and what to do, in one line."""
        return cls(device, kind, f"{found} (needed: {needed}); {advice}")


@dataclass(frozen=True, slots=True)
class View:
    """One projector as one camera sees it.

    Attributes
    ----------
    plan : what to set and expect. peak : brightest lit pixel at venue.toml's exposure [full scale];
        1 or more is saturated. gamma : of the projector's response. additivity : light of two
        halves over that of white; both None where they were not photographed.
    ambient_share : room light over white - black of the darkest lit pixel.
    black_sigmas : black light over read noise at venue.toml's exposure for black.
    black_exposure_s : of the photograph of black, which does not saturate [s].
    """

    plan: ExposurePlan
    peak: float
    gamma: float | None
    additivity: float | None
    ambient_share: float
    black_sigmas: float
    black_exposure_s: float


@dataclass(frozen=True, slots=True)
class CameraView:
    """One camera.

    Attributes
    ----------
    black_level_dn : measured [DN]. ambient_per_s : median of room light and dark current [full scale/s].
    repeat : brightness of a white after bright pictures over that of the same white after black.
    exponents : how signals grow with exposure, from t/2 to t and from t/4 to t/2; 1 is linear.
    """

    black_level_dn: float
    ambient_per_s: float
    repeat: float | None = None
    exponents: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Behaviour:
    """Results of the tests of one projector with `camera`, and why some could not be run."""

    camera: str
    effects: tuple[Effect, ...] = ()
    untested: tuple[str, ...] = ()


@dataclass
class Diagnosis:
    """All that was found; `controls` is each projector's state in words, `views` by (projector, camera).

    `behaviour` is by projector, of those that were tested.
    """

    findings: list[Finding] = field(default_factory=list)
    controls: dict[str, dict[str, Any]] = field(default_factory=dict)
    cameras: dict[str, CameraView] = field(default_factory=dict)
    views: dict[tuple[str, str], View] = field(default_factory=dict)
    behaviour: dict[str, Behaviour] = field(default_factory=dict)
    photographs: int = 0

    def add(self, *parts: str) -> None:
        """Add a finding: device, kind, found, needed, advice."""
        self.keep(Finding.of(*parts))

    def keep(self, finding: Finding) -> None:
        """Add a finding, unless this device has one of its kind."""
        if all((f.device, f.kind) != (finding.device, finding.kind) for f in self.findings):
            self.findings.append(finding)

    def has(self, device: str, *kinds: str) -> bool:
        """Whether a device has a finding of one of the kinds."""
        return any(f.device == device and f.kind in kinds for f in self.findings)

    def capture(self) -> dict[str, float]:
        """[capture] that suits every projector and camera; empty if nothing could be measured.

        Black is exposed no shorter than it was photographed: where projectors cannot be made dark, a
        photograph of one's black holds that of all, and looks long enough when it is not.
        """
        views = self.views.values()
        if not views:
            return {}
        exposure_s = min(view.plan.exposure_s for view in views)
        each = [max(view.plan.black_exposure_s, view.black_exposure_s) for view in views]
        black_s = max(exposure_s, *each)
        return {"exposure_s": exposure_s, "black_exposure_s": black_s}

    def lines(self) -> str:
        """What to paste into venue.toml."""
        return ", ".join(f"{key} = {value:g}" for key, value in self.capture().items())

    def as_dict(self) -> dict[str, Any]:
        """One document for machines."""
        tested = {name: asdict(behaviour) for name, behaviour in self.behaviour.items()}
        return {
            "ok": not self.findings,
            "findings": [{**asdict(f), "line": str(f)} for f in self.findings],
            "photographs": self.photographs,
            "capture": self.capture(),
            "cameras": {name: asdict(camera) for name, camera in self.cameras.items()},
            "controls": self.controls,
            "views": [
                {"projector": projector, "camera": camera, **asdict(view)}
                for (projector, camera), view in self.views.items()
            ],
            **({"behaviour": tested} if tested else {}),
        }


LEAST_PEAK, MOST_PEAK = 0.4, 0.98  # at venue.toml's exposure
LEAST_SNR = 10.0
LEAST_LIT_SHARE = 0.01
NOT_ADDITIVE = 0.03
GAMMA_OFF = 0.35  # what the waves' own harmonic takes up; 2.0 and 2.4 are within
NOMINAL = 2.2
LEAST_BLACK_SIGMAS = 5.0
MOST_AMBIENT = 0.25
REPEAT_OFF = 0.03
EXPONENT_OFF = 0.05
NO_LIGHT = 0.02  # of full scale, at the longest exposure tried
FLAT_EXPONENT = 0.2  # a picture that hardly follows its exposure: no encoding does so
BLACK_LEVEL_OFF = 5e-4  # of full scale


UNTRUSTWORTHY = (
    "auto-exposure",
    "response",
)  # findings after which a camera's pictures are not used
MOVING = ("dynamic-black", "constant-light")  # findings that explain why light does not add up

BEHAVIOUR = {  # what was measured, and the finding for a value above and below 0
    "load-half": ("{} in a white patch as half light comes up elsewhere", *MOVING),
    "load-full": ("{} in a white patch as white comes up elsewhere", *MOVING),
    "white-after-black": ("{} in white after white, against white after 30 s of black", *MOVING),
    "primaries": ("{} in white, against red + green + blue", "white-boost", "white-boost"),
    "secondaries": (
        "{} in white, against half of cyan + magenta + yellow",
        "white-boost",
        "white-boost",
    ),
    "white-end": ("{} of the step from 247/255 to white missing", *2 * ("limited-range",)),
    "black-end": ("{} of the step from black to 16/255 missing", *2 * ("limited-range",)),
    "grey-stripes": (
        "{} in fine stripes of grey, against what their levels make",
        *2 * ("edge-enhancement",),
    ),
    "slants": ("{} in fine stripes of one slant, against the other", *2 * ("pixel-shift",)),
    "after-0-s": ("{} of the picture before left in a new one", *2 * ("slow-picture",)),
    "after-0.2-s": ("{} of the picture before left after 0.2 s", *2 * ("slow-picture",)),
    "after-0.5-s": ("{} of the picture before left after 0.5 s", *2 * ("slow-picture",)),
}
SWITCH = {
    "dynamic-black": 'switch "dynamic contrast" / "auto iris" / "dynamic black" off',
    "constant-light": 'switch "constant light" / "constant brightness" and power saving off',
    "white-boost": 'switch "brilliant colour" / "white boost" off',
    "limited-range": 'set "HDMI video range" to full / 0-255 / expanded, in the player too',
    "edge-enhancement": 'switch "sharpness" / "detail clarity" / "super resolution" off',
    "pixel-shift": 'switch "pixel shift" / "4K enhancement" / "e-shift" off',
    "slow-picture": 'switch "frame interpolation" and "noise reduction" off, or let the player wait',
}


def judge_behaviour(diagnosis: Diagnosis, projector: str) -> None:
    """Add the settings of a projector to switch off; of several signs of one the strongest counts."""
    found = [e for e in diagnosis.behaviour[projector].effects if e.found]
    for effect in sorted(found, key=lambda e: -abs(e.value) / e.limit):
        sentence, above, below = BEHAVIOUR[effect.name]
        kind = above if effect.value > 0 else below
        got = sentence.format(f"{effect.value:+.1%} (sigma {effect.sigma:.1%})")
        diagnosis.add(
            f"projector {projector}", kind, got, f"{effect.limit:.1%} at most", SWITCH[kind]
        )


def judge_dark(diagnosis: Diagnosis, device: str, camera: CameraView, sensor: Sensor) -> None:
    """Add the faults that the dark frames show; `sensor` is venue.toml's."""
    off_dn = camera.black_level_dn - sensor.black_level
    if abs(off_dn) > max(1.0, BLACK_LEVEL_OFF * sensor.full_scale):
        diagnosis.add(
            device,
            "black-level",
            f"{camera.black_level_dn:.1f} counts in the dark at exposure 0",
            f"black_level = {sensor.black_level:g} of venue.toml",
            f"set black_level = {camera.black_level_dn:.1f}, and check that the pictures are raw",
        )


def judge_response(diagnosis: Diagnosis, device: str, camera: CameraView) -> None:
    """Add the faults that repeated photographs of white show."""
    exponents, repeat = camera.exponents, camera.repeat
    flat = bool(exponents) and all(abs(e) < FLAT_EXPONENT for e in exponents)
    if flat or (repeat is not None and abs(repeat - 1) > REPEAT_OFF):
        change = f"x{2 ** exponents[0]:.2f} from exposure t/2 to t" if flat else f"x{repeat:.2f}"
        diagnosis.add(
            device,
            "auto-exposure",
            f"{change} between two photographs of white" + ("" if flat else ", one after black"),
            "x2" if flat else "the same brightness at the same settings",
            "switch automatic exposure, gain, ISO and flicker reduction off (mode M), and let the "
            "lamps warm up",
        )
    elif any(abs(e - 1) > EXPONENT_OFF for e in exponents):
        shown = " and ".join(f"x{2**e:.2f}" for e in exponents)
        diagnosis.add(
            device,
            "response",
            f"{shown} for twice the exposure",
            'x2: response = "linear"',
            "take raw pictures, with gamma, tone curve and dynamic range optimiser off",
        )


def judge_views(diagnosis: Diagnosis) -> None:
    """Add the faults that photographs of projectors show."""
    for (projector, camera), view in diagnosis.views.items():
        _judge_ambient(diagnosis, f"camera {camera}", projector, view)
        _judge_exposure(diagnosis, f"projector {projector}", f"camera {camera}", view)
        _judge_noise(diagnosis, f"projector {projector}", view)
        _judge_projector(diagnosis, f"projector {projector}", view)


def _judge_ambient(diagnosis: Diagnosis, camera: str, projector: str, view: View) -> None:
    if view.ambient_share > MOST_AMBIENT:
        diagnosis.add(
            camera,
            "ambient",
            f"room light of {view.ambient_share:.0%} of what projector {projector} gives its "
            "darkest pixel",
            f"less than {MOST_AMBIENT:.0%}",
            "switch the room lights off, cover exit signs and monitors, close the doors",
        )


def _judge_exposure(diagnosis: Diagnosis, device: str, camera: str, view: View) -> None:
    capture = diagnosis.capture()
    advice = f"set {diagnosis.lines()} under [capture]"
    own_s, common_s = view.plan.exposure_s, capture["exposure_s"]
    got = f"white at {view.peak:.0%} of {camera}'s full scale"
    if view.peak > MOST_PEAK:
        got = f"white that saturates {camera}" if view.peak >= 1 else got
        diagnosis.add(device, "too-bright", got, f"{LEAST_PEAK:.0%} to {MOST_PEAK:.0%}", advice)
    elif view.peak < LEAST_PEAK:
        if own_s > common_s / LEAST_PEAK:
            advice = (
                f"it wants {own_s:g} s where another takes {common_s:g}: check its lamp, brightness "
                "and picture mode"
            )
        diagnosis.add(device, "too-dim", got, f"{LEAST_PEAK:.0%} to {MOST_PEAK:.0%}", advice)
    longer = capture["black_exposure_s"] > view.black_exposure_s
    if longer and view.black_sigmas < LEAST_BLACK_SIGMAS:
        diagnosis.add(
            device,
            "black-too-short",
            f"black light of {view.black_sigmas:.1f} sigma of read noise",
            f"{LEAST_BLACK_SIGMAS:g} or more",
            f"set black_exposure_s = {capture['black_exposure_s']:g} under [capture]",
        )


def _judge_noise(diagnosis: Diagnosis, device: str, view: View) -> None:
    if view.plan.snr_bracket < LEAST_SNR:
        diagnosis.add(
            device,
            "noisy",
            f"signal to noise {view.plan.snr_bracket:.1f} of the darkest lit pixel after "
            f"{MAX_EXPOSURES} exposures",
            f"{LEAST_SNR:g} or more, better {TARGET_SNR:g}",
            "open the aperture, lower ISO, or use the projector's brightest mode",
        )


def _judge_projector(diagnosis: Diagnosis, device: str, view: View) -> None:
    if view.plan.lit_share < LEAST_LIT_SHARE:
        diagnosis.add(
            device,
            "hardly-seen",
            f"{view.plan.lit_share:.1%} of the camera's picture lit",
            f"{LEAST_LIT_SHARE:.0%} or more",
            "turn the camera towards its picture, or use a wider lens",
        )
    if view.additivity is None or view.gamma is None:
        return
    if abs(view.additivity - 1) > NOT_ADDITIVE:
        if not diagnosis.has(device, *MOVING):
            diagnosis.add(
                device,
                "dynamic-black",
                f"{view.additivity:.1%} of white from its two halves one after the other",
                "100 %",
                "switch dynamic black, auto iris, eco dimming, white boost and constant-light off",
            )
    elif abs(view.gamma - NOMINAL) > GAMMA_OFF:
        diagnosis.add(
            device,
            "gamma",
            f"mid-grey as of gamma {view.gamma:.2f}",
            f"{NOMINAL} within {GAMMA_OFF}",
            "choose the projector's plain picture mode (gamma 2.2, full range), and check that the "
            "player applies no colour profile",
        )
