"""A camera's counts from the radiance at its lens: veiling glare, vignetting, noise, black level."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from procam.arrays import BoolArray, Image
from procam.errors import UnitError
from simulators.builds import CameraBuild
from simulators.presets import white_exposure_s
from simulators.scene import ALL_BANDS, GREEN, DomeScene, camera_circle

NORMAL_TABLE = ndtri((np.arange(2**16) + 0.5) / 2**16).astype(np.float32)
NOISELESS_BITS = 16  # a file holds integers
DARKEST = 0.005  # quantile of the lit pixels; a few may lie under a seam or a mark
BORDER_SIGMAS = 4.0  # distance at which a Gaussian is negligible
LOCAL = 0.04  # spread of the local veil, a Gaussian sigma [share of the picture]
COARSE = 4  # cells of the grid on which it is spread [px]
ROUNDING = 1 / 12  # variance of a count's rounding [DN^2]


@dataclass(frozen=True)
class Noise:
    """Variance of a signal: `per_dn` times the signal (shot) plus the square of `read_dn` [DN]."""

    per_dn: float
    read_dn: float

    def variance(self, signal_dn: float) -> float:
        """Variance [DN^2] of a signal [DN] before it is rounded."""
        return self.per_dn * signal_dn + self.read_dn**2

    def scaled(self, factor: float) -> "Noise":
        """The same law with its variance multiplied."""
        return Noise(self.per_dn * factor, self.read_dn * factor**0.5)


class Sensor:
    """One camera of a scene, from radiance to counts; signals are shares of full scale."""

    def __init__(self, scene: DomeScene, name: str) -> None:
        self._scene, self._name = scene, name
        self._build = scene.cameras[name]
        self._preset = scene.preset
        self.vignetting = _vignetting(self._build)
        circle = camera_circle(self._build)
        self._mean_weight = (circle / circle.sum()).astype(np.float32).ravel()

    @property
    def blur_px(self) -> float:
        """Gaussian sigma of lens and pixel [projector px]; a camera pixel covers about 1.3 of them."""
        return 1.3 * self._build.blur_px

    @property
    def full_dn(self) -> float:
        """Saturation above the black level [DN] of a camera with noise."""
        return 2**self._build.bits - 1 - self._build.black_level

    def signal(self, radiance: Image, exposure_s: float) -> Image:
        """Signal (H, W, C) without noise, in the memory of the radiance (H, W, C)."""
        glare, local = self._preset.glare, self._build.flaws.local_veil
        veil = self._mean_weight @ radiance.reshape(self._mean_weight.size, -1)
        if local:
            veil = np.float32(local) * self._spread(radiance) + np.float32(1 - local) * veil
        radiance *= np.float32(1 - glare)
        radiance += np.float32(glare) * veil
        bands = GREEN if radiance.shape[-1] == 1 else ALL_BANDS
        gain = np.array(self._build.flaws.gain, np.float32)[bands]
        radiance *= self.vignetting * (np.float32(exposure_s * self._build.aperture) * gain)
        return radiance

    def black_drift(self, time_s: float) -> float:
        """Rise of the black level by a time [full scale]."""
        return self._build.flaws.black_drift_dn * time_s / 600.0 / self.full_dn

    def _spread(self, radiance: Image) -> Image:
        """Radiance (H, W, C) spread over `LOCAL` of the picture; computed on a coarse grid."""
        height, width, channels = radiance.shape
        sigma = LOCAL * min(width, height) / COARSE
        small = cv2.resize(
            radiance, (width // COARSE, height // COARSE), interpolation=cv2.INTER_AREA
        )
        soft = cv2.resize(cv2.GaussianBlur(small, (0, 0), sigma), (width, height))
        return np.asarray(soft.reshape(height, width, channels), np.float32)

    def digitise(
        self, signal: Image, rng: np.random.Generator, noise: Noise | None
    ) -> NDArray[np.uint16]:
        """Counts [DN] of a signal: shot and read noise, black level, saturation, rounding.

        Without `noise` they have 16 bits. The signal is not changed.
        """
        black_level = np.float32(self._build.black_level)
        if noise is None:
            top = 2**NOISELESS_BITS - 1
            exact = np.rint(signal * (top - float(black_level)) + black_level)
            return np.clip(exact, 0, top).astype(np.uint16)
        counts = signal * np.float32(self.full_dn)
        sigma = np.maximum(counts, 0)
        sigma *= np.float32(noise.per_dn)
        sigma += np.float32(noise.read_dn**2)
        np.sqrt(sigma, out=sigma)
        sigma *= _normal(rng, signal.shape)
        counts += sigma
        counts += black_level
        np.rint(counts, out=counts)
        return np.clip(counts, 0, 2**self._build.bits - 1, out=counts).astype(np.uint16)

    @cached_property
    def noise(self) -> Noise | None:
        """The noise of the scene's preset; None for a camera without."""
        preset = self._preset
        if preset.darkest_snr is not None:
            return self.noise_of_snr(preset.darkest_snr, white_exposure_s(preset))
        return None if preset.white_snr is None else self._law(preset.white_snr)

    def noise_of_snr(self, snr: float, exposure_s: float) -> Noise:
        """The noise that gives the darkest lit pixel a ratio (`Overrides.snr`) at an exposure."""
        white, difference = (exposure_s * self.full_dn * v for v in self._darkest_per_s)
        law = self._law(self._preset.white_snr or 100.0)
        wanted = (difference / snr) ** 2 - ROUNDING
        if not wanted > 0:
            most = difference / ROUNDING**0.5
            raise UnitError(
                f"snr of camera {self._name} is {snr:g}; {self._build.bits} bits allow less than {most:.0f} "
                f"at {exposure_s:g} s. Set a lower one or expose longer"
            )
        return law.scaled(wanted / law.variance(white))

    def _law(self, white_snr: float) -> Noise:
        return Noise(0.7 * self.full_dn / white_snr**2, self._build.read_noise_dn)

    @cached_property
    def _darkest_per_s(self) -> tuple[float, float]:
        """Signal of white, and of white less black, at the darkest lit pixel [full scale/s].

        A camera keeps its noise when the venue drifts.
        """
        if self._scene.undrifted is not self._scene:
            return Sensor(self._scene.undrifted, self._name)._darkest_per_s
        each = [self._darkest_of(name) for name in self._scene.lights]
        return min(each, key=lambda pair: pair[1])

    def _darkest_of(self, projector: str) -> tuple[float, float]:
        scene = self._scene
        lines, light = scene.sight_lines(self._name), scene.lights[projector]

        def signal(level: int) -> Image:
            picture = np.full((*light.lit.shape, 1), level, np.uint8)
            irradiance = {projector: light.emit_grey(picture, GREEN)}
            radiance = scene.radiance_of_irradiances(lines, irradiance, 1, self.blur_px)
            return self.signal(radiance, 1.0)[..., 0]

        white, black = signal(255), signal(0)
        inner = _clear_of_border(light.lit, BORDER_SIGMAS * light.smear_px(self.blur_px))
        clear = np.isfinite(lines.projector_pixels(projector, inner)[..., 0])
        white = white[clear]
        difference = white - black[clear]
        rank = int(DARKEST * len(difference))
        place = np.argpartition(difference, rank)[rank]
        return float(white[place]), float(difference[place])


def _clear_of_border(lit: BoolArray, margin_px: float) -> BoolArray:
    """Pixels (H, W) at least `margin_px` inside the lit part, or its middle half if that is narrow."""
    framed = np.pad(lit.astype(np.uint8), 1)
    distance = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(distance > min(margin_px, 0.5 * float(distance.max())))


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Image:
    """Standard normal noise from a table of 16 random bits: twice as fast, accurate to 4 sigma."""
    count = int(np.prod(shape))
    bits = rng.bit_generator.random_raw(-(-count // 4)).view(np.uint16)[:count]
    return NORMAL_TABLE[bits].reshape(shape)


def _vignetting(build: CameraBuild) -> Image:
    width, height = build.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    theta = np.arccos(np.clip(build.rays(pixels)[..., 2], -1, 1))
    factor = np.ones_like(theta)
    for power, coefficient in enumerate(build.vignetting, start=1):
        factor += coefficient * theta ** (2 * power)
    middle = (np.array(build.size) - 1) / 2
    factor *= 1 + ((pixels - middle) / middle) @ np.array(build.flaws.vignetting_slope)
    return np.where(camera_circle(build), factor, 0.0).astype(np.float32)[..., None]
