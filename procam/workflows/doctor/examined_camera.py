"""One camera under examination: its own measurements, and those of each projector.

It shows white, black, grey and halves of each projector, and keeps what `findings` judges. The file is
longer than 300 lines because all measurements share the state of one camera.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray, Image
from procam.devices.protocols import Camera
from procam.devices.rig import Rig
from procam.errors import DeviceError, StaleFrame
from procam.estimate.camera.checks import (
    additivity,
    brightness_ratio,
    fit_dark_frames,
    grey_gamma,
    response_exponent,
)
from procam.estimate.camera.exposure import (
    DARK_QUANTILE,
    direct_light,
    green,
    meter,
    plan_exposures,
)
from procam.estimate.camera.noise import NoiseLaw, noise_from_neighbours, noise_from_repeat
from procam.files.venue.tables import CaptureTable
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor
from procam.workflows.doctor.findings import (
    NO_LIGHT,
    UNTRUSTWORTHY,
    CameraView,
    Diagnosis,
    View,
    judge_dark,
    judge_response,
)

Counts = NDArray[np.uint16]
METERINGS = 3
BRIGHT, DIM = 0.999, 0.1  # quantile looked at, and the share of the best exposure that will do
GREY = 128 / 255
SETTLE_S = 0.5  # [s] before a stale picture is retaken
SLOW_S = 1.0  # before a photograph of a projector that is known to be slow
SETTINGS_OFF = 0.01
FRACTIONS = (0.5, 0.25)  # of the exposure, for the camera's response
SMALLEST_RATIO = 1.2  # of exposures; closer ones do not determine a response


@dataclass(frozen=True)
class _Shots:
    """One projector as photographed; signals (H, W) above black [DN] at the exposure of white.

    Attributes
    ----------
    level, dark : of white and of black. halves : of the left and the right half of the panel.
    direct : what comes straight from the projector; 0 where not lit.
    """

    white: Frame
    black: Frame
    level: Array
    dark: Array
    grey: Array
    halves: tuple[Array, Array]
    direct: Array

    @property
    def lit(self) -> BoolArray:
        """Lit pixels (H, W), or the bright ones if clipping hides them."""
        span = self.level - self.dark
        return np.asarray(self.direct > 0 if self.direct.any() else span > 0.5 * span.max())


@dataclass
class ExaminedCamera:
    """One camera, and what is known of it by now.

    `ambient` (H, W) is room light and dark current [DN/s], `black_s` an exposure for black [s],
    `noise` as two photographs of the same white had it, `judged` once its response is known,
    `last` what was photographed last.
    """

    rig: Rig
    camera: Camera
    sensor: Sensor
    diagnosis: Diagnosis
    ambient: Array | None = None
    black_s: float = 1.0
    noise: NoiseLaw | None = None
    judged: bool = False
    last: Counts | None = None

    @property
    def device(self) -> str:
        """What findings call it."""
        return f"camera {self.camera.name}"

    @property
    def measured(self) -> Sensor:
        """The sensor with the black level that was measured."""
        known = self.diagnosis.cameras[self.camera.name]
        return replace(self.sensor, black_level=known.black_level_dn)

    def look_at_dark(self, capture: CaptureTable) -> None:
        """Black level and room light, with all projectors dark."""
        long = self._unsaturated(capture.black_exposure_s)
        self.black_s = long.settings.exposure_s
        short = self.take(min(capture.exposure_s, self.black_s / 4))
        seconds = (short.settings.exposure_s, long.settings.exposure_s)
        level, self.ambient = self.sensor.black_level, np.zeros(long.counts.shape[:2])
        if seconds[0] < seconds[1]:  # else the camera took no notice, and has a finding for it
            level, self.ambient = fit_dark_frames(green(short.counts), green(long.counts), seconds)
        ambient = float(np.median(self.ambient)) / self.sensor.full_scale
        self.diagnosis.cameras[self.camera.name] = CameraView(level, ambient)
        judge_dark(
            self.diagnosis, self.device, self.diagnosis.cameras[self.camera.name], self.sensor
        )

    def look_at(self, projector: str, capture: CaptureTable) -> None:
        """White, black, grey and halves of a projector; the first one also examines the camera."""
        black, white = self.metered(projector, capture)
        shots = self._shots(projector, black, white)
        if shots is None:
            self._tell_no_light(projector)
            return
        if not self.judged:
            self._look_at_response(projector, white, shots.lit)
        if self.diagnosis.has(self.device, *UNTRUSTWORTHY):
            return  # a camera that alters its pictures does not measure a projector
        if self._clipped(white):
            self._tell_saturated(projector, white.settings.exposure_s)
            return
        view = self._view(self.rig.projectors[projector].size, shots, capture)
        self.diagnosis.views[projector, self.camera.name] = view

    def _shots(self, projector: str, black: Frame, white: Frame) -> "_Shots | None":
        """The other pictures of a projector that gives light; None for one that does not."""
        exposure_s = white.settings.exposure_s
        level = self._signal(white)
        dark = self._signal(black) * (exposure_s / black.settings.exposure_s)
        if float(np.quantile(level - dark, BRIGHT)) < NO_LIGHT * self.sensor.full_scale:
            return None
        grey, left, right = (
            self._signal(self._show(projector, name, exposure_s))
            for name in ("grey", "left", "right")
        )
        both = (green(white.counts), green(black.counts))
        noise = self.noise or noise_from_neighbours(both, self.measured)
        direct = direct_light(left, right, level - dark, np.sqrt(noise.variance(level)))
        return _Shots(white, black, level, dark, grey, (left, right), direct)

    def _view(self, panel: tuple[int, int], shots: "_Shots", capture: CaptureTable) -> View:
        """What the pictures of one projector show."""
        assert self.ambient is not None and self.noise is not None
        seconds = (shots.white.settings.exposure_s, shots.black.settings.exposure_s)
        plan = plan_exposures(
            shots.white.counts,
            shots.black.counts,
            exposures_s=seconds,
            sensor=self.measured,
            panel=panel,
            direct=shots.direct,
            noise=self.noise,
        )
        lit, ambient = shots.lit, self.ambient[shots.lit]
        black = float((shots.dark[lit] / seconds[0] - ambient).mean()) * capture.black_exposure_s
        darkest = float(np.quantile((shots.level - shots.dark)[lit], DARK_QUANTILE)) / seconds[0]
        return View(
            plan,
            plan.peak * capture.exposure_s / seconds[0],
            grey_gamma(shots.grey, shots.level, shots.dark, lit, GREY),
            additivity(shots.halves, shots.level, shots.dark, lit),
            float(np.median(ambient)) / darkest,
            black / float(np.sqrt(self.noise.variance(0.0))),
            seconds[1],
        )

    def _look_at_response(self, projector: str, white: Frame, lit: BoolArray) -> None:
        """The same white again, now after bright pictures, and at parts of its exposure."""
        asked_s = white.settings.exposure_s
        frames = [self._show(projector, "white", asked_s * part) for part in (1.0, *FRACTIONS)]
        signals = [self._signal(frame) for frame in frames]
        self.noise = noise_from_repeat(green(white.counts), green(frames[0].counts), self.measured)
        if self.diagnosis.has(f"projector {projector}", "dynamic-black"):
            return  # its light moves, whatever the camera does
        exponents = []
        for (longer, shorter), (a, b) in zip(pairwise(frames), pairwise(signals), strict=True):
            ratio = longer.settings.exposure_s / shorter.settings.exposure_s
            usable = lit & (a < self.measured.full_scale)
            if ratio > SMALLEST_RATIO and (usable & (a > 0) & (b > 0)).any():
                exponents.append(response_exponent(a, b, ratio, usable))
        known = replace(
            self.diagnosis.cameras[self.camera.name],
            repeat=brightness_ratio(self._signal(white), signals[0], lit),
            exponents=tuple(exponents),
        )
        self.diagnosis.cameras[self.camera.name] = known
        self.judged = True
        judge_response(self.diagnosis, self.device, known)

    def metered(
        self, projector: str, capture: CaptureTable, wait_s: float = 0.0
    ) -> tuple[Frame, Frame]:
        """Black, and white after it at an exposure that neither clips it nor leaves it in the noise.

        Each is photographed once it has been up for `wait_s`.
        """
        exposure_s = capture.exposure_s
        longest_s = max(capture.exposure_s, capture.black_exposure_s)
        for _ in range(METERINGS):
            black = self._show(projector, "black", self.black_s, wait_s)
            white = self._show(projector, "white", exposure_s, wait_s)
            now_s = white.settings.exposure_s
            better_s = meter(white.counts, now_s, self.measured)
            if now_s <= better_s <= now_s / DIM:
                break
            exposure_s = min(better_s, longest_s)
        return black, white

    def _unsaturated(self, exposure_s: float) -> Frame:
        """A photograph at an exposure [s], or at a shorter one if room light saturates it."""
        for _ in range(METERINGS):
            frame = self.take(exposure_s)
            self._compare(exposure_s, frame)
            if not self._clipped(frame):
                break
            exposure_s /= 16
        return frame

    def _clipped(self, frame: Frame) -> bool:
        return float(np.quantile(frame.counts, BRIGHT)) >= 2**self.sensor.bits - 1

    def _signal(self, frame: Frame) -> Array:
        """Green counts (H, W) above the measured black level [DN]."""
        return green(frame.counts) - self.measured.black_level

    def _show(self, projector: str, name: str, exposure_s: float, wait_s: float = 0.0) -> Frame:
        """Photograph one of the plain pictures."""
        picture = _picture(name, self.rig.projectors[projector].size)
        if self.diagnosis.has(f"projector {projector}", "slow-picture"):
            wait_s = SLOW_S
        return self.photograph(projector, picture, exposure_s, title=name, wait_s=wait_s)

    def photograph(
        self, projector: str, picture: Image, exposure_s: float, *, title: str, wait_s: float
    ) -> Frame:
        """Photograph a picture (H, W, 3) that has been up for a while; a stale one is retaken once."""
        shown = self.rig.projectors[projector].show(picture)
        self.rig.clock.sleep(wait_s)
        before = self.last
        for _ in range(2):
            frame = self.take(exposure_s)
            same = (
                before is not None and np.ptp(before) > 0 and np.array_equal(before, frame.counts)
            )
            if frame.started_s >= shown.at_s and not same:
                self._compare(exposure_s, frame)
                return frame
            self.diagnosis.add(
                self.device,
                "stale",
                f"the picture before it instead of {title} of projector {projector}",
                "one taken after the picture was up",
                "add a delay to the player, or check the camera's trigger and buffer",
            )
            self.rig.clock.sleep(SETTLE_S)
        raise StaleFrame(
            f"{self.device}: the camera delivered old pictures of {title} twice in a row; check its "
            "trigger and buffer"
        )

    def take(self, exposure_s: float) -> Frame:
        """One photograph."""
        try:
            self.camera.configure(CameraSettings(exposure_s))
            frame = self.camera.capture()
        except DeviceError as error:
            raise type(error)(f"{self.device}: {error}") from error
        self.diagnosis.photographs += 1
        width, height = self.camera.size
        if frame.counts.shape[:2] != (height, width):
            raise DeviceError(
                f"{self.device}: its pictures have {frame.counts.shape[1]}x{frame.counts.shape[0]} px, "
                f"but venue.toml says {width}x{height}; correct one of the two"
            )
        self.last = frame.counts
        return frame

    def _compare(self, exposure_s: float, frame: Frame) -> None:
        """Record a finding if the settings of a photograph differ from those asked for."""
        got, asked = frame.settings, CameraSettings(exposure_s)
        if abs(got.exposure_s / asked.exposure_s - 1) > SETTINGS_OFF or got.gain != asked.gain:
            self.diagnosis.add(
                self.device,
                "settings",
                f"{got.exposure_s:.4g} s at gain {got.gain:g}",
                f"{asked.exposure_s:.4g} s at gain {asked.gain:g} as asked",
                "switch it to manual (mode M), and name exposures that it has in venue.toml",
            )
        top = 2**self.sensor.bits - 1
        if frame.counts.max() > top:
            self.diagnosis.add(
                self.device,
                "bits",
                f"counts up to {frame.counts.max()}",
                f"{top} at most for bits = {self.sensor.bits} of venue.toml",
                "correct bits, and check that the pictures are raw",
            )

    def _tell_saturated(self, projector: str, exposure_s: float) -> None:
        self.diagnosis.add(
            f"projector {projector}",
            "too-bright",
            f"white that saturates {self.device} even at {exposure_s:.3g} s",
            "less",
            "close the aperture, lower ISO, check that no lamp shines into the camera, and that its "
            "exposure is manual",
        )

    def _tell_no_light(self, projector: str) -> None:
        self.diagnosis.add(
            f"projector {projector}",
            "no-light",
            f"a black picture of white in {self.device}",
            "light",
            "check its lamp, shutter, input and signal, the camera's lens cap, and raise exposure_s",
        )


def _picture(name: str, size: tuple[int, int]) -> Image:
    """A test picture (H, W, 3): black, grey, white, or the left or right half white."""
    width, height = size
    level = {"black": 0.0, "grey": GREY}.get(name, 1.0)
    picture = np.full((height, width, 3), level, np.float32)
    if name == "left":
        picture[:, width // 2 :] = 0
    elif name == "right":
        picture[:, : width // 2] = 0
    return picture
