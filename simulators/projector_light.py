"""Light of one projector on the screen: direct, per projector pixel and per room patch."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, Array, BoolArray, Image, IndexArray
from procam.maths.geometry.lenses import unproject
from procam.maths.geometry.sphere import normalise
from simulators.builds import ProjectorBuild, same_geometry
from simulators.ends import LitPixels
from simulators.solid_angles import grid_solid_angles
from simulators.surface import Surface
from simulators.transport import dome_patch
from simulators.walled_room import WalledSurface

AnySurface = Surface | WalledSurface
MIN_SMEAR_PX = 0.4  # sigma that draws a shift between two pixels on their grid


@dataclass(frozen=True)
class ProjectorLight:
    """The light of one projector's pixels.

    Attributes
    ----------
    direction, solid_angle_sr : (H, W, 3) and (H, W) place and weight of the pixel, as in `LitPixels`.
    lit : (H, W) the pixel passes the blackout plates.
    irradiance : (H, W) at full white, relative to the scene's unit; 0 where not lit.
    black_irradiance : (H, W) at drive 0.
    area_m2 : (H, W) the pixel's true area. reflected_m2 : (H, W) albedo times area.
    patch : (H, W) room patch under the pixel.
    level : light that the lamp sends through a pixel without falloff [irradiance m^2].
    """

    build: ProjectorBuild
    direction: Array
    solid_angle_sr: Array
    lit: BoolArray
    irradiance: Image
    black_irradiance: Image
    patch: IndexArray
    area_m2: Image
    reflected_m2: Array
    level: float

    @classmethod
    def on(
        cls, surface: AnySurface, build: ProjectorBuild, level: float | None = None
    ) -> "ProjectorLight":
        """Trace the pixels of `build` to the screen.

        Without a `level` its lamp gives the preset's brightness.
        """
        if isinstance(surface, Surface):
            on = _on_dome(surface, build)
        else:
            on = surface.lit_pixels(build)
        shape = (
            _falloff(build) * on.lit / on.area_m2
        )  # the panel sends equal flux through equal pixels
        if level is None:
            level = float(surface.preset.brightness / np.median(shape[on.lit]))
        black = build.black * level * on.lit / on.area_m2
        return cls(
            build,
            on.place,
            on.weight,
            on.lit,
            (level * shape).astype(np.float32),
            black.astype(np.float32),
            on.patch,
            on.area_m2.astype(np.float32),
            on.albedo * on.area_m2,
            level,
        )

    def emit(self, drive: Image, bands: slice) -> Image:
        """Irradiance (H, W, C) on the dome in the camera bands for a drive (H, W, 3)."""
        if self.build.scaler:
            drive = self.build.scaler.scaled(drive)
        light = self.build.linear(drive).reshape(-1, 3) @ self._mix(bands).T
        return self._irradiance(light.reshape(*drive.shape[:2], -1), bands)

    def emit_grey(self, picture: NDArray[np.uint8], bands: slice) -> Image:
        """Irradiance (H, W, C) of a grey picture (H, W, 1) of 8 bits."""
        # what depends on neighbours has no table
        if self.build.features.edge_enhancement or self.build.scaler:
            return self.emit(np.repeat(picture / np.float32(255), 3, axis=2), bands)
        levels = np.arange(256, dtype=np.float32)[:, None] / np.float32(255)
        table = self.build.linear(np.repeat(levels, 3, axis=1)) @ self._mix(bands).T
        light = [cv2.LUT(picture[..., 0], np.ascontiguousarray(c)) for c in table.T]
        return self._irradiance(np.stack(light, axis=-1), bands)

    def _mix(self, bands: slice) -> Image:
        return self.build.colour_mix[bands].astype(np.float32)

    def _irradiance(self, light: Image, bands: slice) -> Image:
        """Irradiance (H, W, C) of relative light (H, W, C), which is overwritten."""
        white = self.build.colour_mix[bands].sum(axis=1).astype(np.float32)
        light *= self.irradiance[..., None]
        light += self.black_irradiance[..., None] * white
        return light

    def patch_flux(self, irradiance: Image, patches: int) -> Array:
        """Reflected flux (P, C) per room patch of an irradiance image (H, W, C)."""
        index = self.patch.ravel()
        return np.stack(
            [
                np.bincount(index, (irradiance[..., c] * self.reflected_m2).ravel(), patches)
                for c in range(irradiance.shape[2])
            ],
            axis=1,
        )

    def smear_px(self, camera_blur_px: float) -> float:
        """Gaussian sigma [px] of the projector's lens and the camera together."""
        return float(np.hypot(self.build.defocus_px, camera_blur_px))

    def blurred(self, irradiance: Image, camera_blur_px: float) -> Image:
        """The image blurred by lens and camera pixel, on the projector's grid.

        A lens blurs flux; the area that receives it is that of the pixel where it arrives.
        """
        sigma, shift = self.smear_px(camera_blur_px), self.build.features.pixel_shift
        if sigma == 0 and not shift:
            return irradiance
        area = self.area_m2[..., None]
        flux = _blurred_flux(irradiance * area, sigma, shift)
        return np.asarray(flux.reshape(irradiance.shape) / area, np.float32)

    def altered(self, build: ProjectorBuild, old: AnySurface, new: AnySurface) -> "ProjectorLight":
        """The same lamp in `build`, after the dome's paint and preset went from old to new.

        Its pixels are traced again only if its lens or place differs.
        """
        brighter = new.preset.brightness / old.preset.brightness
        level = self.level * brighter
        if not same_geometry(build, self.build):
            return ProjectorLight.on(new, build, level)
        return replace(
            self,
            build=build,
            irradiance=self.irradiance * np.float32(brighter),
            black_irradiance=self.black_irradiance * np.float32(brighter),
            reflected_m2=self.reflected_m2 * new.relative_albedo(old.preset, self.direction),
            level=level,
        )


def _blurred_flux(flux: Image, sigma: float, shift: float) -> Image:
    """Flux (H, W, C) under a Gaussian [px]; half of it shifted to the right and down [px]."""
    if not shift:
        return np.asarray(
            cv2.GaussianBlur(flux, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT), np.float32
        )
    sigma = max(sigma, MIN_SMEAR_PX)
    reach = np.arange(-np.ceil(4 * sigma + shift), np.ceil(4 * sigma + shift) + 1)
    seen = np.zeros_like(flux)
    for place in (0.0, shift):
        kernel = np.exp(-0.5 * ((reach + place) / sigma) ** 2)  # cv2 correlates: the sign turns
        kernel /= kernel.sum()
        seen += 0.5 * cv2.sepFilter2D(
            flux, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT
        ).reshape(flux.shape)
    return seen


def _on_dome(surface: Surface, build: ProjectorBuild) -> LitPixels:
    width, height = build.size
    direction = _directions(surface, build, np.arange(width), np.arange(height))
    corners = _directions(surface, build, np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
    solid = grid_solid_angles(corners)
    return LitPixels(
        direction,
        solid,
        solid * surface.radius(direction) ** 2,
        direction[..., 2] >= np.cos(surface.lit_half_angle),
        dome_patch(direction, surface.half_angle),
        surface.albedo(direction),
    )


def _directions(surface: Surface, build: ProjectorBuild, x: AnyArray, y: AnyArray) -> Array:
    pixels = np.stack(np.meshgrid(x, y), axis=-1).astype(float)
    back = build.projector_from_dome.inverse()
    rays = back.rotate(unproject(pixels, build.lens))
    return normalise(surface.intersect(back.translation, rays))


def _falloff(build: ProjectorBuild) -> Array:
    width, height = build.size
    x = np.linspace(-1, 1, width)[None, :]
    y = np.linspace(-1, 1, height)[:, None]
    return np.asarray(1 - build.falloff * (x * x + 0.6 * y * y) / 1.6)
