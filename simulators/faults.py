"""Named faults of a simulated venue; see `apply_faults`."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, Array32
from procam.devices.protocols import BackendRig, Camera, Projector, Shown
from procam.errors import InputError
from procam.model.frame import CameraSettings, Frame
from simulators.serial_port import EmulatedEscVp21

STALE_FRAME = 9  # number of the frame that is repeated
TOP_DN, BLACK_DN = 4095, 64  # of the simulated cameras with noise
METERED_QUANTILE, METERED_LEVEL = 0.99, 0.6  # automatic exposure puts the quantile at the level
METER_STEP, LONGEST_S = 8.0, 1.0  # largest change between two pictures; longest exposure [s]
DIM_SHARE = 0.08  # of the light that a lamp at its end still gives
IRIS_SHARE = 0.5  # of the light that passes for a black picture
AMBIENT_PER_S = 0.5  # light of lamps in the room [full scale/s]
SHOT_PER_DN = 0.28  # variance of light per count, as of the presets' white
STUCK_S = 1 / 30
GAMMA = 2.2  # approximate gamma of the projectors


class FaultyCamera:
    """A camera with a fault: as the healthy one, unless overridden."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.name, self.size = camera.name, camera.size

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """As the healthy camera does."""
        return self._camera.configure(settings)

    def capture(self) -> Frame:
        """As the healthy camera does."""
        return self._camera.capture()


class StaleCamera(FaultyCamera):
    """A camera whose trigger fails once: it delivers the picture before the requested one again."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera)
        self._taken = 0
        self._last: Frame | None = None

    def capture(self) -> Frame:
        """The picture, or once the one before it."""
        self._taken += 1
        if self._taken == STALE_FRAME and self._last is not None:
            return self._last
        self._last = self._camera.capture()
        return self._last


class AutoExposureCamera(FaultyCamera):
    """A camera on automatic exposure: it reports the requested settings, but adapts to the last picture."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera)
        self._requested = CameraSettings(0.1)
        self._exposure_s = 0.1

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Store the settings, and keep its own exposure."""
        self._requested = settings
        return settings

    def capture(self) -> Frame:
        """A picture at the exposure that the one before it asks for."""
        self._camera.configure(replace(self._requested, exposure_s=self._exposure_s))
        frame = self._camera.capture()
        level = float(np.quantile(frame.counts, METERED_QUANTILE)) - BLACK_DN
        full = TOP_DN - BLACK_DN
        wanted = 0.0 if level >= full else METERED_LEVEL * full / max(level, 1.0)
        step = float(np.clip(wanted, 1 / METER_STEP, METER_STEP))
        self._exposure_s = float(np.clip(self._exposure_s * step, 1e-4, LONGEST_S))
        return replace(frame, settings=self._requested)


class GammaCamera(FaultyCamera):
    """A camera that encodes its counts for a screen (sRGB, IEC 61966-2-1) without reporting it."""

    def capture(self) -> Frame:
        """The picture, encoded above the black level."""
        frame = self._camera.capture()
        share = (frame.counts.astype(float) - BLACK_DN) / (TOP_DN - BLACK_DN)
        curve = 1.055 * np.maximum(share, 0.0031308) ** (1 / 2.4) - 0.055
        encoded = np.where(share > 0.0031308, curve, 12.92 * share)
        return replace(frame, counts=_counts(BLACK_DN + encoded * (TOP_DN - BLACK_DN)))


class AmbientLightCamera(FaultyCamera):
    """A camera in a room whose lights were left on."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera)
        self._rng = np.random.default_rng(3)

    def capture(self) -> Frame:
        """The picture, with the room's light on top."""
        frame = self._camera.capture()
        light = AMBIENT_PER_S * frame.settings.exposure_s * (TOP_DN - BLACK_DN)
        noise = self._rng.normal(0, np.sqrt(SHOT_PER_DN * light), frame.counts.shape)
        return replace(frame, counts=_counts(frame.counts + light + noise))


class StuckExposureCamera(FaultyCamera):
    """A camera that keeps one exposure, and reports it."""

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Its own exposure, whatever is requested."""
        return self._camera.configure(replace(settings, exposure_s=STUCK_S))


class FaultyProjector:
    """A projector that shows another picture than the one it is sent."""

    def __init__(self, projector: Projector, alter: Callable[[Array32], Array32]) -> None:
        self._projector, self._alter = projector, alter
        self.name, self.size = projector.name, projector.size

    def show(self, drive: Array32) -> Shown:
        """Show the picture as the fault makes it."""
        return replace(self._projector.show(self._alter(drive)), drive=drive)


def dimmed(drive: Array32) -> Array32:
    """A picture (H, W, 3) of a lamp at its end."""
    return drive * np.float32(DIM_SHARE ** (1 / GAMMA))


def iris_follows(drive: Array32) -> Array32:
    """A picture (H, W, 3) of a projector whose iris closes for dark pictures (dynamic black)."""
    share = IRIS_SHARE + (1 - IRIS_SHARE) * float(drive.mean())
    return drive * np.float32(share ** (1 / GAMMA))


CAMERA_FAULTS: Mapping[str, Callable[[Camera], Camera]] = {
    "stale-frame": StaleCamera,
    "auto-exposure": AutoExposureCamera,
    "camera-gamma": GammaCamera,
    "ambient-light": AmbientLightCamera,
    "stuck-exposure": StuckExposureCamera,
}
PROJECTOR_FAULTS: Mapping[str, Callable[[Array32], Array32]] = {
    "dim-projector": dimmed,
    "dynamic-black": iris_follows,
}


def apply_faults(
    rig: BackendRig, wires: Mapping[str, EmulatedEscVp21], names: tuple[str, ...]
) -> BackendRig:
    """The rig with the named faults built in.

    Those of `CAMERA_FAULTS` affect every camera, those of `PROJECTOR_FAULTS` and "unplugged-serial"
    the last projector. They assume the 12-bit cameras of the presets with noise.
    """
    known = {*CAMERA_FAULTS, *PROJECTOR_FAULTS, "unplugged-serial"}
    if not known.issuperset(names):
        raise InputError(
            f"faults {', '.join(names)}: the known ones are {', '.join(sorted(known))}"
        )
    for name in names:
        if name in CAMERA_FAULTS:
            wrap = CAMERA_FAULTS[name]
            rig = replace(rig, cameras={n: wrap(c) for n, c in rig.cameras.items()})
        elif name in PROJECTOR_FAULTS:
            last = list(rig.projectors)[-1]
            faulty = FaultyProjector(rig.projectors[last], PROJECTOR_FAULTS[name])
            rig = replace(rig, projectors={**rig.projectors, last: faulty})
    if "unplugged-serial" in names:
        wire = list(wires.values())[-1]
        wire.faults.commands, wire.faults.unplug_at = b"MUTE OFF", 0
    return rig


def _counts(values: Array) -> NDArray[np.uint16]:
    """Values [DN] as counts of the camera."""
    return np.rint(np.clip(values, 0, TOP_DN)).astype(np.uint16)
