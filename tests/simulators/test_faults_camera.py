"""The named faults have their effects, and no others."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from procam.devices.protocols import BackendRig, Shown
from procam.errors import InputError
from procam.model.frame import CameraSettings, Frame
from simulators.faults import (
    AMBIENT_PER_S,
    BLACK_DN,
    DIM_SHARE,
    IRIS_SHARE,
    METERED_LEVEL,
    STUCK_S,
    TOP_DN,
    apply_faults,
)

FULL_DN = TOP_DN - BLACK_DN
LIGHT_PER_S = np.array([[0.0, 1.0], [2.0, 4.0]])  # full scale/s


class PlainCamera:
    """A camera without noise before a scene of four pixels; `light` scales it."""

    name, size = "plain", (2, 2)

    def __init__(self) -> None:
        self.settings = CameraSettings(0.1)
        self.light = 1.0

    def configure(self, settings: CameraSettings) -> CameraSettings:
        self.settings = settings
        return settings

    def capture(self) -> Frame:
        signal = self.light * LIGHT_PER_S * self.settings.exposure_s * FULL_DN
        counts = np.clip(np.rint(BLACK_DN + signal), 0, TOP_DN).astype(np.uint16)
        return Frame(counts, self.settings, 0.0, 1.0)


class PlainProjector:
    """Keeps what it shows."""

    name, size = "plain", (4, 2)

    def show(self, drive: np.ndarray) -> Shown:
        self.shown = drive
        return Shown(drive, 0.0)


class PlainClock:
    def now_s(self) -> float:
        return 0.0

    def sleep(self, duration_s: float) -> None:
        del duration_s


@pytest.fixture
def rig() -> Iterator[BackendRig]:
    projectors = {"first": PlainProjector(), "last": PlainProjector()}
    yield BackendRig({"camera": PlainCamera()}, projectors, PlainClock())


def signal(rig: BackendRig, exposure_s: float) -> np.ndarray:
    """The camera's signal at an exposure [full scale]."""
    camera = rig.cameras["camera"]
    camera.configure(CameraSettings(exposure_s))
    return (camera.capture().counts - float(BLACK_DN)) / FULL_DN


def test_no_fault_is_no_change(rig: BackendRig) -> None:
    assert apply_faults(rig, {}, ()) is rig


def test_an_unknown_fault_is_refused(rig: BackendRig) -> None:
    with pytest.raises(
        InputError, match=r"faults gremlins: the known ones are ambient-light, auto-"
    ):
        apply_faults(rig, {}, ("gremlins",))


def test_automatic_exposure_ignores_the_settings_but_reports_them(rig: BackendRig) -> None:
    rig = apply_faults(rig, {}, ("auto-exposure",))
    for _ in range(6):
        signal(rig, 0.1)
    settled = signal(rig, 0.1)
    assert settled.max() == pytest.approx(METERED_LEVEL, rel=0.05)
    assert np.allclose(signal(rig, 0.05), settled, atol=0.01)
    asked = CameraSettings(0.0123)
    rig.cameras["camera"].configure(asked)
    assert rig.cameras["camera"].capture().settings == asked


def test_automatic_exposure_lags_by_one_picture(rig: BackendRig) -> None:
    plain = rig.cameras["camera"]
    rig = apply_faults(rig, {}, ("auto-exposure",))
    for _ in range(6):
        before = signal(rig, 0.1)
    plain.light = 0.5  # type: ignore[attr-defined]
    assert np.allclose(signal(rig, 0.1), before / 2, atol=0.02)
    assert np.allclose(signal(rig, 0.1), before, atol=0.02)


def test_camera_gamma_is_srgb_above_black(rig: BackendRig) -> None:
    found = signal(apply_faults(rig, {}, ("camera-gamma",)), 0.125)
    linear = LIGHT_PER_S * 0.125
    encoded = np.where(linear > 0, 1.055 * linear ** (1 / 2.4) - 0.055, 0)
    assert np.allclose(found, encoded, atol=2e-3)


def test_ambient_light_grows_with_exposure(rig: BackendRig) -> None:
    lit = apply_faults(rig, {}, ("ambient-light",))
    for exposure_s in (0.05, 0.2):
        extra = (signal(lit, exposure_s) - signal(rig, exposure_s)).mean()
        assert extra == pytest.approx(AMBIENT_PER_S * exposure_s, abs=0.01)


def test_stuck_exposure_is_reported(rig: BackendRig) -> None:
    camera = apply_faults(rig, {}, ("stuck-exposure",)).cameras["camera"]
    assert camera.configure(CameraSettings(2.0)).exposure_s == STUCK_S
    assert camera.capture().settings.exposure_s == STUCK_S


@pytest.mark.parametrize(("name", "level", "share"), [
    ("dim-projector", 1.0, DIM_SHARE),
    ("dim-projector", 0.5, DIM_SHARE),
    ("dynamic-black", 1.0, 1.0),
    ("dynamic-black", 0.5, IRIS_SHARE + (1 - IRIS_SHARE) / 2),
])  # fmt: skip
def test_the_last_projector_alone_is_darker(
    name: str, level: float, share: float, rig: BackendRig
) -> None:
    struck = apply_faults(rig, {}, (name,))
    drive = np.full((2, 4, 3), level, np.float32)
    for which in ("first", "last"):
        struck.projectors[which].show(drive)
    first, last = (rig.projectors[n].shown for n in ("first", "last"))  # type: ignore[attr-defined]
    assert np.array_equal(first, drive)
    assert np.allclose((last / drive) ** 2.2, share)
    assert replace(struck, projectors=rig.projectors) == rig
