"""Named faults that strike a simulated venue; see `apply_faults`."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from procam.devices.protocols import BackendRig, Camera, Projector, Shown
from procam.errors import InputError
from procam.model.frame import CameraSettings, Frame
from simulators.serial_port import EmulatedEscVp21

STRIKE_AT_FRAME = 9
TOP_DN, BLACK_DN = 4095, 64  # of the simulated cameras with noise
METERED, METER_LEVEL = (
    0.99,
    0.6,
)  # automatic exposure: this quantile goes to this share of full scale
METER_STEP, LONGEST_S = 8.0, 1.0  # at most, from one picture to the next; and in all [s]
DIM_SHARE = 0.08  # of the light that a lamp at its end still gives
IRIS_SHARE = 0.5  # of the light that passes for a black picture
AMBIENT_PER_S = 0.5  # room light [full scale/s]
SHOT_PER_DN = 0.28  # variance of light per count, as of the presets' white
STUCK_S = 1 / 30
GAMMA = 2.2  # of the projectors, by and large


class FaultyCamera:
    """A camera behind a fault: does what the real one does, unless overridden."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self.name, self.size = camera.name, camera.size

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """As the real camera does."""
        return self._camera.configure(settings)

    def capture(self) -> Frame:
        """As the real camera does."""
        return self._camera.capture()


class StaleCamera(FaultyCamera):
    """A camera whose trigger slips once: it delivers the picture before the asked one again."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera)
        self._taken = 0
        self._last: Frame | None = None

    def capture(self) -> Frame:
        """The picture, or once the one before it."""
        self._taken += 1
        if self._taken == STRIKE_AT_FRAME and self._last is not None:
            return self._last
        self._last = self._camera.capture()
        return self._last


class AutoExposureCamera(FaultyCamera):
    """A camera on automatic exposure: it says what it was asked, and follows the last picture."""

    def __init__(self, camera: Camera) -> None:
        super().__init__(camera)
        self._asked = CameraSettings(0.1)
        self._exposure_s = 0.1

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Takes note, and keeps its own exposure."""
        self._asked = settings
        return settings

    def capture(self) -> Frame:
        """A picture at the exposure that the one before it would have wanted."""
        self._camera.configure(replace(self._asked, exposure_s=self._exposure_s))
        frame = self._camera.capture()
        level = float(np.quantile(frame.counts, METERED)) - BLACK_DN
        full = TOP_DN - BLACK_DN
        wanted = 0.0 if level >= full else METER_LEVEL * full / max(level, 1.0)
        step = float(np.clip(wanted, 1 / METER_STEP, METER_STEP))
        self._exposure_s = float(np.clip(self._exposure_s * step, 1e-4, LONGEST_S))
        return replace(frame, settings=self._asked)


class GammaCamera(FaultyCamera):
    """A camera that encodes its counts for a screen (sRGB, IEC 61966-2-1) and does not say so."""

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
    """A camera that keeps one exposure, and admits it."""

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Its own exposure, whatever is asked."""
        return self._camera.configure(replace(settings, exposure_s=STUCK_S))


class FaultyProjector:
    """A projector that shows another picture than it is sent."""

    def __init__(
        self,
        projector: Projector,
        alter: Callable[[NDArray[np.float32]], NDArray[np.float32]],
    ) -> None:
        self._projector, self._alter = projector, alter
        self.name, self.size = projector.name, projector.size

    def show(self, drive: NDArray[np.float32]) -> Shown:
        """Show the picture as the fault makes it."""
        return replace(self._projector.show(self._alter(drive)), drive=drive)


def dimmed(drive: NDArray[np.float32]) -> NDArray[np.float32]:
    """A picture (H, W, 3) of a lamp at its end."""
    return drive * np.float32(DIM_SHARE ** (1 / GAMMA))


def iris_follows(drive: NDArray[np.float32]) -> NDArray[np.float32]:
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
PROJECTOR_FAULTS: Mapping[str, Callable[[NDArray[np.float32]], NDArray[np.float32]]] = {
    "dim-projector": dimmed,
    "dynamic-black": iris_follows,
}


def apply_faults(
    rig: BackendRig, wires: Mapping[str, EmulatedEscVp21], names: tuple[str, ...]
) -> BackendRig:
    """The rig with the named faults built in.

    Those of `CAMERA_FAULTS` strike every camera, those of `PROJECTOR_FAULTS` and "unplugged-serial"
    the last projector. They know the 12-bit cameras of the presets with noise.
    """
    known = {*CAMERA_FAULTS, *PROJECTOR_FAULTS, "unplugged-serial"}
    if not known.issuperset(names):
        raise InputError(
            f"faults: got {', '.join(names)}, expected some of {', '.join(sorted(known))}"
        )
    for name in names:
        if name in CAMERA_FAULTS:
            wrap = CAMERA_FAULTS[name]
            rig = replace(rig, cameras={n: wrap(c) for n, c in rig.cameras.items()})
        elif name in PROJECTOR_FAULTS:
            last = list(rig.projectors)[-1]
            struck = FaultyProjector(rig.projectors[last], PROJECTOR_FAULTS[name])
            rig = replace(rig, projectors={**rig.projectors, last: struck})
    if "unplugged-serial" in names:
        wire = list(wires.values())[-1]
        wire.faults.commands, wire.faults.unplug_at = b"MUTE OFF", 0
    return rig


def _counts(values: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Values [DN] as the camera would deliver them."""
    return np.rint(np.clip(values, 0, TOP_DN)).astype(np.uint16)
