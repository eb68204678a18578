"""Photographs outside a capture are of what was asked for, or say why not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fake_devices import Clock

from procam.errors import DeviceError, StaleFrame
from procam.model.frame import CameraSettings, Frame
from procam.model.optics import Sensor
from procam.workflows.capture.checked_camera import ATTEMPTS, BREATH_S, CheckedCamera, Pictures

SENSOR = Sensor(bits=12, black_level=64.0)
WHITE = {"south": np.ones((8, 8, 3), np.float32)}
SETTINGS = CameraSettings(0.1)


class Script:
    """A camera with photographs of given light, which says that they have some settings."""

    name, size = "zenith", (56, 56)

    def __init__(self, light: Sequence[float], said: CameraSettings | None = None) -> None:
        self._light, self._said = list(light), said
        self.in_force = SETTINGS

    def configure(self, settings: CameraSettings) -> CameraSettings:
        self.in_force = replace(settings, gain=self.in_force.gain)
        return self.in_force

    def capture(self) -> Frame:
        level = self._light.pop(0)
        counts = np.full((56, 56, 3), 64 + level, np.uint16)
        counts[:28] += np.uint16(level)
        return Frame(counts, self._said or self.in_force, 0.0, 0.1)


def test_the_picture_before_is_taken_again() -> None:
    clock = Clock()
    camera = CheckedCamera(Script([1000, 1000, 500]), SENSOR, clock)
    camera.photograph("white", SETTINGS, WHITE)
    frame = camera.photograph("stripes", SETTINGS, _other(WHITE))
    assert frame.counts[-1, -1, 0] == 564
    assert clock.now_s() == BREATH_S


def test_a_camera_that_stays_late_is_refused() -> None:
    camera = CheckedCamera(Script([1000] * (1 + ATTEMPTS)), SENSOR, Clock())
    camera.photograph("white", SETTINGS, WHITE)
    with pytest.raises(StaleFrame, match="stripes: the camera delivered the picture before it"):
        camera.photograph("stripes", SETTINGS, _other(WHITE))


def test_a_dark_projector_may_look_as_before() -> None:
    """A verification names it."""
    camera = CheckedCamera(Script([1000] * (1 + ATTEMPTS)), SENSOR, Clock(), may_look_alike=True)
    camera.photograph("white", SETTINGS, WHITE)
    assert camera.photograph("stripes", SETTINGS, _other(WHITE)).counts.any()


def test_other_settings_than_the_camera_set() -> None:
    camera = CheckedCamera(Script([1000] * 9, CameraSettings(0.2)), SENSOR, Clock())
    with pytest.raises(StaleFrame, match=r"white: the camera set 0\.1 s.* says 0\.2 s"):
        camera.photograph("white", SETTINGS, WHITE)


def test_gain_is_refused() -> None:
    script = Script([1000])
    script.in_force = CameraSettings(0.1, gain=4.0)
    with pytest.raises(DeviceError, match="camera zenith: its gain is 4 and must stay 1"):
        CheckedCamera(script, SENSOR, Clock()).photograph("white", SETTINGS, WHITE)


def _other(pictures: Pictures) -> Pictures:
    return {name: np.zeros_like(picture) for name, picture in pictures.items()}
