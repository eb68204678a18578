"""Lines of sight of a camera or an eye into the scene: where they end, and the radiance along them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from procam.arrays import Array, BoolArray, Image, IndexArray
from procam.maths.geometry.lenses import project
from procam.maths.geometry.sphere import normalise
from simulators.projector_light import AnySurface, ProjectorLight
from simulators.transport import Room

GLOSS_EXPONENT = 20


@dataclass(frozen=True)
class SightLines:
    """A grid of lines of sight into the room, prepared for many pictures.

    Attributes
    ----------
    on_screen : (H, W) the line ends on the dome or a wall. albedo : (H, W) of what it ends on.
    scatter_at : (H, W, 2) where to read the room's image of scattered irradiance.
    below : flat places of the lines that end on what has no image, and the room patches there.
    sources : per projector, (H, W, 2) projector pixel and (H, W) direct radiance per irradiance.
    origin, point, outward : (3,) where the lines start, (H, W, 3) where they end on the screen [m], and the
        normals there, away from the room.
    """

    on_screen: BoolArray
    albedo: Image
    scatter_at: Image
    below: tuple[IndexArray, IndexArray]
    sources: dict[str, tuple[Image, Image]]
    origin: Array
    point: Image
    outward: Image

    @classmethod
    def along(
        cls, room: Room, lights: dict[str, ProjectorLight], origin: Array, rays: Array
    ) -> "SightLines":
        """Lines of sight from `origin` (3,) [m] along unit `rays` (H, W, 3); NaN rays end nowhere."""
        ends = room.ends(origin, rays)
        sources = {
            name: _source(light, room.surface, ends.point, ends.outward, origin, ends.on_screen)
            for name, light in lights.items()
        }
        return cls(
            ends.on_screen,
            ends.albedo.astype(np.float32),
            ends.scatter_at,
            ends.below,
            {n: (xy, (gain * ends.albedo).astype(np.float32)) for n, (xy, gain) in sources.items()},
            origin,
            ends.point.astype(np.float32),
            ends.outward.astype(np.float32),
        )

    def repainted(self, old: AnySurface, new: AnySurface) -> "SightLines":
        """The same lines of sight after the paint went from old to new."""
        factor = new.relative_albedo(old.preset, self.point.astype(float)).astype(np.float32)
        if np.all(factor == 1):
            return self
        sources = {name: (where, gain * factor) for name, (where, gain) in self.sources.items()}
        return replace(self, albedo=self.albedo * factor, sources=sources)

    def with_lights(self, moved: Mapping[str, ProjectorLight], surface: AnySurface) -> "SightLines":
        """The same lines of sight, traced again to the projectors that have moved.

        Their pixels are accurate to 1e-3 px where the screen is near the lens, elsewhere to 1e-4 px.
        """
        point, outward = self.point.astype(float), self.outward.astype(float)
        sources = dict(self.sources)
        for name, light in moved.items():
            where, gain = _source(light, surface, point, outward, self.origin, self.on_screen)
            sources[name] = where, (gain * self.albedo).astype(np.float32)
        return replace(self, sources=sources)

    def projector_pixels(self, name: str, lit: BoolArray) -> Image:
        """Projector pixel (H, W, 2) at the end of each line of sight, NaN outside its picture.

        `lit` (H, W) are the projector's pixels that pass the blackout plates.
        """
        where = self.sources[name][0]
        height, width = lit.shape
        inside = np.all((where >= -0.5) & (where < (width - 0.5, height - 0.5)), axis=-1)
        column, row = np.rint(np.where(inside[..., None], where, 0)).astype(np.intp).T
        reached = inside & lit[row.T.clip(0, height - 1), column.T.clip(0, width - 1)]
        return np.where(reached[..., None], where, np.float32(np.nan))

    def direct(self, name: str, irradiance: Image) -> Image:
        """Directly reflected radiance (H, W, C) of projector `name`'s irradiance image."""
        where, gain = self.sources[name]
        seen = cv2.remap(  # type: ignore[call-overload]
            irradiance, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
        ).reshape(*gain.shape, -1)
        return np.asarray(np.multiply(seen, gain[..., None], out=seen), np.float32)

    def scattered(self, room: Room, patch_irradiance: Array) -> Image:
        """Radiance (H, W, C) of scattered light."""
        image = room.patch_image(patch_irradiance)
        seen = cv2.remap(image, self.scatter_at, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
        seen = seen.reshape(*self.albedo.shape, -1)
        np.multiply(seen, self.albedo[..., None], out=seen)
        place, patch = self.below
        seen.reshape(-1, seen.shape[-1])[place] = (
            patch_irradiance[patch] * room.albedo[patch][:, None]
        )
        return np.asarray(seen, dtype=np.float32)


def _source(
    light: ProjectorLight,
    surface: AnySurface,
    point: Array,
    outward: Array,
    eye: Array,
    on_screen: BoolArray,
) -> tuple[Image, Array]:
    """Projector pixel under each point, and radiance per irradiance and albedo (1 if matte)."""
    build, gloss = light.build, surface.preset.gloss
    lens = build.projector_from_dome.origin
    pixel = project(build.projector_from_dome.apply(point), build.lens)
    visible = on_screen & np.isfinite(pixel[..., 0]) & surface.sees(lens, point)
    where = np.where(visible[..., None], pixel, -10.0).astype(np.float32)
    if not gloss:
        return where, visible.astype(float)
    incoming = normalise(point - lens)
    mirror = incoming - 2 * np.sum(incoming * outward, axis=-1, keepdims=True) * outward
    towards_eye = normalise(eye - point)
    cosine = np.maximum(np.sum(mirror * towards_eye, axis=-1), 0)
    lobe = (GLOSS_EXPONENT + 2) / 2 * cosine**GLOSS_EXPONENT
    return where, visible * (1 - gloss + gloss * lobe)
