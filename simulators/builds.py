"""How the simulated projectors and cameras are built: lens, colours, response, menu features."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Self

import cv2
import numpy as np

from procam.arrays import Array, Array32
from procam.errors import InputError
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.pose import Pose

UNSHARP_PX = 1.0  # Gaussian sigma of an unsharp mask [px]
RIPPLES, RIPPLE_STEPS = 3, 4
LARGEST = {"white_boost": 5.0, "edge_enhancement": 5.0, "pixel_shift": 4.0}  # of features
LARGEST |= {"iris_s": 600.0, "picture_delay_s": 600.0}  # [s]
SETTLING_S = 120.0  # time constant of a lamp that settles after its warm-up [s]


@dataclass(frozen=True, slots=True)
class Features:
    """Features of a projector's menu that please viewers, and of its lamp; they disturb measurements.

    Attributes
    ----------
    white_boost : relative gain of the part that red, green and blue share, by a white segment,
        against pure colours; white itself keeps its level.
    dynamic_black : share of the light that an iris takes from a black picture; it follows the
        picture's mean drive, `iris_s` [s] behind.
    constant_light : share of the light lost at a white picture; in step with the mean drive.
    pixel_shift : shift of every other refresh to the right and down [px].
    limited_range : 1 for an input whose black is 16 and whose white is 235, of 255; less for limits
        nearer to 0 and 255.
    edge_enhancement : gain of an unsharp mask, of `UNSHARP_PX`, on the drive.
    picture_delay_s : time from the confirmation of a new picture to its appearance [s].
    settling : share of the light that the lamp lacks when its warm-up ends; it decays exponentially
        with `SETTLING_S`.
    """

    white_boost: float = 0.0
    dynamic_black: float = 0.0
    iris_s: float = 0.3
    constant_light: float = 0.0
    pixel_shift: float = 0.0
    limited_range: float = 0.0
    edge_enhancement: float = 0.0
    picture_delay_s: float = 0.0
    settling: float = 0.0

    @classmethod
    def named(cls, sizes: Mapping[str, float]) -> Self:
        """Features by their names in venue.toml, such as "white-boost"; the others are off."""
        known = {f.name.replace("_", "-"): f.name for f in fields(cls)}
        for name, size in sizes.items():
            if name not in known:
                raise InputError(f"feature {name} is not one of {', '.join(sorted(known))}")
            most = LARGEST.get(known[name], 1.0)
            if not 0 <= size <= most:
                raise InputError(f"feature {name} is {size:g}; it must be 0 to {most:g}")
        return cls(**{known[name]: size for name, size in sizes.items()})

    def processed(self, drive: Array32) -> Array32:
        """The drive (H, W, 3) of the panel for a drive at the input."""
        if not (self.limited_range or self.edge_enhancement):
            return drive
        if self.limited_range:
            low, high = self.limited_range * 16 / 255, 1 - self.limited_range * 20 / 255
            drive = (drive - np.float32(low)) / np.float32(high - low)
        if self.edge_enhancement:
            smooth = cv2.GaussianBlur(drive, (0, 0), UNSHARP_PX)
            drive = drive + np.float32(self.edge_enhancement) * (drive - smooth)
        return np.clip(drive, 0, 1)

    def boosted(self, light: Array32) -> Array32:
        """Light (..., 3) of the primaries with that of the white segment."""
        if not self.white_boost:
            return light
        shared = np.float32(self.white_boost) * light.min(axis=-1, keepdims=True)
        return (light + shared) / np.float32(1 + self.white_boost)


@dataclass(frozen=True)
class Scaler:
    """What a projector does to the picture at its input before the panel shows it.

    Attributes
    ----------
    panel_from_input : (3, 3) homography of pixels; outside of the picture the panel is black.
    lift : drive that the brightness control adds to black; white stays.
    connected : False for a projector that has lost its input and shows black.
    """

    panel_from_input: Array = field(default_factory=lambda: np.eye(3))
    lift: float = 0.0
    connected: bool = True

    def scaled(self, drive: Array32) -> Array32:
        """The drive (H, W, 3) of the panel for a drive at the input."""
        if not self.connected:
            return np.zeros_like(drive)
        lifted = np.float32(self.lift) + np.float32(1 - self.lift) * drive
        size = drive.shape[1], drive.shape[0]
        return np.asarray(cv2.warpPerspective(lifted, self.panel_from_input, size), np.float32)


@dataclass(frozen=True)
class ProjectorBuild:
    """One projector as it was made and installed.

    Attributes
    ----------
    colour_mix : (3, 3) light in each camera band per primary; rows sum to the white of the band.
    gamma, toe : (3,) response: (1 - toe) v^gamma + toe v^2 (3 - 2 v).
    falloff : loss of light towards the panel's corners [-].
    black : light at drive 0 relative to white; it leaks without the falloff.
    defocus_px : Gaussian sigma of lens and screen [px].
    bits : depth of the picture input [bit]. features : those that its menu has switched on.
    scaler : None for pictures shown as they arrive.
    """

    name: str
    size: tuple[int, int]
    lens: Lens
    projector_from_dome: Pose
    colour_mix: Array
    gamma: Array
    toe: Array
    falloff: float
    black: float
    defocus_px: float = 0.7
    bits: int = 10
    features: Features = field(default_factory=Features)
    scaler: Scaler | None = None

    def linear(self, drive: Array32) -> Array32:
        """Relative light (..., 3) of the primaries for a drive (..., 3) in 0..1, as quantised."""
        steps = 2**self.bits - 1
        code = np.rint(self.features.processed(drive) * np.float32(steps)).astype(np.intp)
        table = self.response(np.arange(steps + 1) / steps).astype(np.float32)
        if np.array_equal(code[..., 0], code[..., 1]) and np.array_equal(
            code[..., 0], code[..., 2]
        ):
            light = table[code[..., 0]]  # grey: one look-up instead of three
        else:
            light = np.stack([table[:, c][code[..., c]] for c in range(3)], axis=-1)
        return self.features.boosted(light)

    @property
    def pose(self) -> Pose:
        """The same as `projector_from_dome`, by the name that all devices share."""
        return self.projector_from_dome

    def response(self, drive: Array) -> Array:
        """Light (N, 3) of the three primaries at drives (N,)."""
        v = drive[:, None]
        return np.asarray((1 - self.toe) * v**self.gamma + self.toe * v * v * (3 - 2 * v))


@dataclass(frozen=True, slots=True)
class CameraFlaws:
    """What a camera has and no value of venue.toml can say.

    Attributes
    ----------
    local_veil : share of the veiling glare that stays within a tenth of the picture.
    vignetting_slope : relative change of its light from the middle to the right and the lower edge.
    ripple_px : amplitude of three waves of radial distortion from the middle to the edge [px].
    black_drift_dn : rise of the black level in 600 s [DN].
    gain : red, green and blue light of its photographs, relative to when it was installed.
    """

    local_veil: float = 0.0
    vignetting_slope: tuple[float, float] = (0.0, 0.0)
    ripple_px: float = 0.0
    black_drift_dn: float = 0.0
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class CameraBuild:
    """One camera on its tripod.

    `vignetting` are the coefficients of 1 + v1 theta^2 + v2 theta^4 off the axis, `blur_px` the
    Gaussian sigma of lens and pixel [px], `read_noise_dn` [DN]; `pupil` the coefficients of the forward
    shift of its entrance pupil, p1 theta^2 + p2 theta^4 [m]; `aperture` the light of its photographs
    relative to what its settings say.
    """

    name: str
    size: tuple[int, int]
    lens: Lens
    camera_from_dome: Pose
    vignetting: tuple[float, ...] = (-0.04, -0.004)
    blur_px: float = 0.5
    bits: int = 12
    black_level: float = 64.0
    read_noise_dn: float = 1.5
    pupil: tuple[float, float] = (0.0, 0.0)
    flaws: CameraFlaws = CameraFlaws()
    aperture: float = 1.0

    @property
    def pose(self) -> Pose:
        """The same as `camera_from_dome`, by the name that all devices share."""
        return self.camera_from_dome

    def rays(self, pixel: Array) -> Array:
        """Unit rays (..., 3) in its frame of pixels (..., 2)."""
        return unproject(pixel + self._ripple(pixel), self.lens)

    def pixels(self, point: Array) -> Array:
        """Pixels (..., 2) of points (..., 3) in its frame."""
        without = found = project(point, self.lens)
        if self.flaws.ripple_px:
            for _ in range(RIPPLE_STEPS):
                found = without - self._ripple(found)
        return found

    def _ripple(self, pixel: Array) -> Array:
        """Displacement (..., 2) [px] of pixels (..., 2) by what no lens model has."""
        if not self.flaws.ripple_px:
            return np.zeros_like(pixel)
        away = pixel - self.lens.centre
        radius = np.linalg.norm(away, axis=-1, keepdims=True)
        wave = np.sin(2 * np.pi * RIPPLES * radius / (min(self.size) / 2))
        return np.asarray(self.flaws.ripple_px * wave * away / np.maximum(radius, 1.0))


def same_geometry(
    first: ProjectorBuild | CameraBuild, second: ProjectorBuild | CameraBuild
) -> bool:
    """Whether two states of one device have the same lens in the same place."""
    pairs = (
        (first.lens.focal, second.lens.focal),
        (first.lens.centre, second.lens.centre),
        (first.lens.distortion, second.lens.distortion),
        (first.pose.rotation, second.pose.rotation),
        (first.pose.translation, second.pose.translation),
    )
    return all(np.array_equal(a, b) for a, b in pairs)
