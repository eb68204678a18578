"""Simulated projector inputs and cameras of one `DomeScene`."""

import numpy as np

from procam.arrays import Array32
from procam.devices.protocols import Shown
from procam.errors import ShapeError, UnitError
from procam.model.frame import CameraSettings, Frame
from simulators.scene import ALL_BANDS, GREEN, DomeScene
from simulators.sensor import Sensor

SETTLE_S = 0.1
READOUT_S = 0.2


def require_drive(what: str, drive: Array32, size: tuple[int, int]) -> None:
    """Refuse a drive that is not (H, W, 3) of `size` (width, height) in 0..1."""
    shape = (size[1], size[0], 3)
    if drive.shape != shape:
        raise ShapeError(what, drive.shape, f"{shape}")
    low, high = float(drive.min()), float(drive.max())
    if not (low >= 0 and high <= 1):
        raise UnitError(f"{what} is {low:.3g}..{high:.3g}; it must be 0..1")


class SimulatedProjector:
    """The picture input of a projector of the scene."""

    def __init__(self, scene: DomeScene, name: str) -> None:
        self._scene = scene
        self.name = name
        self.size = scene.size.projector_size
        self._steps = np.float32(2 ** scene.lights[name].build.bits - 1)

    def show(self, drive: Array32) -> Shown:
        """Show `drive` (H, W, 3) in 0..1, quantised to the input's depth."""
        require_drive(f"drive of projector {self.name}", drive, self.size)
        quantised = np.rint(drive * self._steps) / self._steps
        self._scene.show(self.name, quantised.astype(np.float32))
        self._scene.clock.sleep(SETTLE_S)
        return Shown(self._scene.shown[self.name], self._scene.clock.now_s())


class SimulatedCamera:
    """A raw camera: linear, with vignetting, veiling glare, noise, depth and saturation."""

    def __init__(self, scene: DomeScene, name: str) -> None:
        self._scene = scene
        self._sensor = Sensor(scene, name)
        self.name = name
        self.size = scene.cameras[name].size
        self._settings = CameraSettings(exposure_s=0.1)

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Set an exposure from 0.1 ms to 60 s; the gain is fixed."""
        exposure_s = float(np.clip(settings.exposure_s, 1e-4, 60.0))
        self._settings = CameraSettings(exposure_s, settings.pixel_format)
        return self._settings

    def capture(self) -> Frame:
        """Photograph the screen as it is now."""
        settings, clock = self._settings, self._scene.clock
        started = clock.now_s()
        bands = GREEN if settings.pixel_format == "mono" else ALL_BANDS
        lines = self._scene.sight_lines(self.name)
        radiance = self._scene.radiance(lines, bands, self._sensor.blur_px)
        drift = 1 + self._scene.preset.drift * started / 600.0
        signal = self._sensor.signal(radiance, drift * settings.exposure_s)
        noise_stream = self._scene.noise_stream(self.name, settings)
        signal += np.float32(self._sensor.black_drift(started))
        counts = self._sensor.digitise(signal, noise_stream, self._sensor.noise)
        clock.sleep(settings.exposure_s + READOUT_S)
        if settings.pixel_format == "mono":
            counts = counts[..., 0]
        return Frame(counts, settings, started, clock.now_s())
