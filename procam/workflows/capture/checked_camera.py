"""A camera whose photographs are of what was asked for: its settings, and not the picture before."""

from collections.abc import Callable, Mapping

import numpy as np

from procam.arrays import Array, Image
from procam.devices.protocols import Camera, Clock
from procam.errors import DeviceError, StaleFrame
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor

ATTEMPTS = 3
BREATH_S = 0.5  # [s] before a retake
PROBE_STEP = 7  # checks read every 7th pixel: enough to distinguish pictures
OTHER_PICTURE = 0.05  # mean difference of drives that a photograph must show
# of the brightest light, on average over the frame and over what is lit in it: photographs of other pictures
# differ by more in the one or the other, however little of the frame a screen takes
SAME_LIGHT, SAME_LIT, LIT = 0.01, 0.03, 0.1

Pictures = Mapping[str, Image]


class CheckedCamera:
    """A camera of a rig.

    A photograph of other settings than are in force, or of the picture before, is retaken after 0.5 s
    (`BREATH_S`), twice at most. With `may_look_alike` what looks like the picture before is accepted then:
    a projector may be dark, which the caller judges.
    """

    def __init__(
        self, camera: Camera, sensor: Sensor, clock: Clock, *, may_look_alike: bool = False
    ) -> None:
        self._camera, self.sensor, self._clock = camera, sensor, clock
        self._may_look_alike = may_look_alike
        self._last: tuple[Array, Pictures, float] | None = None

    def photograph(
        self,
        what: str,
        settings: CameraSettings,
        pictures: Pictures,
        judge: Callable[[Frame], None] = lambda _: None,
    ) -> Frame:
        """A photograph of `pictures`, the drives (H, W, 3) of projectors that are lit.

        `what` names it in errors; `judge` raises what else is wrong with a photograph.

        Raises
        ------
        DeviceError
            The camera's gain is not 1.
        StaleFrame
            Its photographs stay those of other settings, or of the picture before.
        """
        in_force = self._camera.configure(settings)
        if in_force.gain != 1:
            raise DeviceError(
                f"camera {self._camera.name}: its gain is {in_force.gain:g} and must stay 1; set it to manual"
            )
        for attempt in range(ATTEMPTS):
            if attempt:
                self._clock.sleep(BREATH_S)
            frame = self._camera.capture()
            other = _other_settings(frame, in_force)
            if other:
                continue
            judge(frame)
            stale = self._is_stale(frame, pictures)
            if not stale:
                break
        if other:
            raise StaleFrame(f"{what}: {other}")
        if stale and not self._may_look_alike:
            raise StaleFrame(
                f"{what}: the camera delivered the picture before it {ATTEMPTS} times; "
                "add a delay to the player or check the camera's trigger"
            )
        self._last = (probe(frame, self.sensor), pictures, frame.settings.exposure_s)
        return frame

    def _is_stale(self, frame: Frame, pictures: Pictures) -> bool:
        """The drives differ a lot, the photographs by no more than noise."""
        if self._last is None or not pictures:
            return False
        before, shown, exposure_s = self._last
        if not shown or exposure_s != frame.settings.exposure_s or not _differ(shown, pictures):
            return False
        now = probe(frame, self.sensor)
        level = max(float(np.percentile(now, 99)), float(np.percentile(before, 99)))
        away, lit = np.abs(now - before), np.maximum(now, before) > LIT * level
        if float(away.mean()) >= SAME_LIGHT * level:
            return False
        return not lit.any() or float(away[lit].mean()) < SAME_LIT * level


def probe(frame: Frame, sensor: Sensor) -> Array:
    """Green light (h, w) of every 7th pixel [DN]."""
    counts = frame.counts if frame.counts.ndim == 2 else frame.counts[..., 1]
    return counts[::PROBE_STEP, ::PROBE_STEP].astype(float) - sensor.black_level


def _differ(shown: Pictures, following: Pictures) -> bool:
    """Whether photographs of two sets of pictures must differ."""
    pairs = list(zip(shown.values(), following.values(), strict=False))
    return len(shown) != len(following) or any(
        first.shape != second.shape or float(np.abs(first - second).mean()) >= OTHER_PICTURE
        for first, second in pairs
    )


def _other_settings(frame: Frame, in_force: CameraSettings) -> str:
    """How a photograph's settings differ from those that the camera set, whatever was asked for."""
    if frame.settings == in_force:
        return ""
    return (
        f"the camera set {_in_words(in_force)}, but its photograph says {_in_words(frame.settings)}, "
        f"{ATTEMPTS} times; set its exposure and gain to manual, or check its trigger"
    )


def _in_words(settings: CameraSettings) -> str:
    return f"{settings.exposure_s:g} s, gain {settings.gain:g}, {settings.pixel_format}"
