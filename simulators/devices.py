"""Simulated projector inputs and cameras: windows on one `DomeScene`."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from procam.devices.protocols import Shown
from procam.errors import ShapeError, UnitError
from procam.maths.lenses import unproject
from procam.model.frame import CameraSettings, Frame
from simulators.rig import CameraBuild
from simulators.scene import ALL_BANDS, GREEN, DomeScene, camera_circle

SETTLE_S = 0.1
READOUT_S = 0.2
NORMAL_TABLE = ndtri((np.arange(2**16) + 0.5) / 2**16).astype(np.float32)


class SimulatedProjector:
    """The picture input of a projector of the scene."""

    def __init__(self, scene: DomeScene, name: str) -> None:
        self._scene = scene
        self.name = name
        self.size = scene.size.projector_size
        self._steps = np.float32(2 ** scene.lights[name].build.bits - 1)

    def show(self, drive: NDArray[np.float32]) -> Shown:
        """Show `drive` (H, W, 3) in 0..1, quantised to the input's depth."""
        width, height = self.size
        if drive.shape != (height, width, 3):
            raise ShapeError(
                f"drive of projector {self.name}", drive.shape, f"{(height, width, 3)}"
            )
        low, high = float(drive.min()), float(drive.max())
        if not (low >= 0 and high <= 1):
            raise UnitError(
                f"drive of projector {self.name}: got {low:.3g}..{high:.3g}, expected 0..1"
            )
        quantised = np.rint(drive * self._steps) / self._steps
        self._scene.shown[self.name] = quantised.astype(np.float32)
        self._scene.clock.sleep(SETTLE_S)
        return Shown(self._scene.shown[self.name], self._scene.clock.now_s())


class SimulatedCamera:
    """A raw camera: linear, with vignetting, veiling glare, noise, depth and saturation."""

    def __init__(self, scene: DomeScene, name: str) -> None:
        self._scene = scene
        self._build: CameraBuild = scene.cameras[name]
        self.name = name
        self.size = self._build.size
        self._settings = CameraSettings(exposure_s=0.1)
        self._vignetting = _vignetting(self._build)
        circle = camera_circle(self._build)
        self._mean_weight = (circle / circle.sum()).astype(np.float32).ravel()

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Takes any exposure from 0.1 ms to 60 s; the gain is fixed."""
        exposure_s = float(np.clip(settings.exposure_s, 1e-4, 60.0))
        self._settings = CameraSettings(exposure_s, settings.pixel_format)
        return self._settings

    def capture(self) -> Frame:
        """Photograph what is on the screen now."""
        settings, clock = self._settings, self._scene.clock
        started = clock.now_s()
        bands = GREEN if settings.pixel_format == "mono" else ALL_BANDS
        view = self._scene.camera_view(self.name)
        # one camera pixel covers about 1.3 projector pixels of the usual venues
        signal = self._scene.radiance(view, bands, 1.3 * self._build.blur_px)
        drift = 1 + self._scene.preset.drift * started / 600.0
        veil = self._scene.preset.glare
        mean = self._mean_weight @ signal.reshape(self._mean_weight.size, -1)
        signal *= np.float32(1 - veil)
        signal += np.float32(veil) * mean
        signal *= self._vignetting * np.float32(drift * settings.exposure_s)
        counts = self._digitise(signal)
        clock.sleep(settings.exposure_s + READOUT_S)
        if settings.pixel_format == "mono":
            counts = counts[..., 0]
        return Frame(counts, settings, started, clock.now_s())

    def _digitise(self, signal: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Shot and read noise, black level, saturation, rounding. 1.0 is full scale."""
        build, preset = self._build, self._scene.preset
        if preset.white_snr is None:
            # noise-free, but a file holds integers: 16 bits of them
            scale = (2**16 - 1 - build.black_level) * 1.0
            return np.clip(np.rint(signal * scale + build.black_level), 0, 2**16 - 1).astype(
                np.uint16
            )
        full = 2**build.bits - 1 - build.black_level
        per_count = 0.7 * full / preset.white_snr**2
        signal *= np.float32(full)
        spread = np.maximum(signal, 0)
        spread *= np.float32(per_count)
        spread += np.float32(build.read_noise_dn**2)
        np.sqrt(spread, out=spread)
        spread *= _normal(self._scene.noise_stream(self.name, self._settings), signal.shape)
        signal += spread
        signal += np.float32(build.black_level)
        np.rint(signal, out=signal)
        return np.clip(signal, 0, 2**build.bits - 1, out=signal).astype(np.uint16)


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Standard normal noise by table from 16 random bits each: twice as fast, good to 4 sigma."""
    count = int(np.prod(shape))
    bits = rng.bit_generator.random_raw(-(-count // 4)).view(np.uint16)[:count]
    return NORMAL_TABLE[bits].reshape(shape)


def _vignetting(build: CameraBuild) -> NDArray[np.float32]:
    width, height = build.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    theta = np.arccos(np.clip(unproject(pixels, build.lens)[..., 2], -1, 1))
    factor = np.ones_like(theta)
    for power, coefficient in enumerate(build.vignetting, start=1):
        factor += coefficient * theta ** (2 * power)
    return np.where(camera_circle(build), factor, 0.0).astype(np.float32)[..., None]
