"""The one scene that all devices of a simulated venue share."""

import zlib
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.maths.lenses import unproject
from procam.model.frame import CameraSettings
from simulators.clock import SceneClock
from simulators.light import ProjectorLight
from simulators.presets import Preset
from simulators.projector_state import ProjectorState
from simulators.rig import CameraBuild, hang_projectors, set_up_cameras
from simulators.surface import Surface
from simulators.transport import Room
from simulators.view import View

Array = NDArray[np.float64]
Image = NDArray[np.float32]
GREEN = slice(1, 2)
ALL_BANDS = slice(0, 3)


@dataclass(frozen=True)
class SceneSize:
    """How many devices and how fine; `rays` per patch is a power of two."""

    projectors: int = 2
    projector_size: tuple[int, int] = (1280, 800)
    cameras: int = 1
    camera_size: tuple[int, int] = (1600, 1600)
    camera_kind: str = "fisheye"
    rays: int = 2048


class DomeScene:
    """Dome, room, projectors and cameras, and what is on the screen now."""

    def __init__(self, preset: Preset, size: SceneSize, seed: int) -> None:
        self.preset, self.size, self.seed = preset, size, seed
        self.clock = SceneClock()
        self.surface = Surface.build(preset)
        builds = hang_projectors(size.projectors, size.projector_size, preset.radius_m)
        with ThreadPoolExecutor(2) as pool:
            room = pool.submit(Room.trace, self.surface, size.rays)
            lights = pool.map(lambda build: ProjectorLight.on(self.surface, build), builds)
            self.lights = {light.build.name: light for light in lights}
            self.room = room.result()
        self.cameras = {
            c.name: c
            for c in set_up_cameras(
                size.cameras, size.camera_size, size.camera_kind, preset.radius_m
            )
        }
        self.states = {name: ProjectorState(self.clock) for name in self.lights}
        black = np.zeros((size.projector_size[1], size.projector_size[0], 3), np.float32)
        self.shown: dict[str, Image] = dict.fromkeys(self.lights, black)
        self._views: dict[str, View] = {}
        self._repeats: dict[int, int] = {}

    def radiance(self, view: View, bands: slice, blur_px: float) -> Image:
        """Radiance (H, W, C) [full scale/s] along a view of what is on the screen now."""
        drives = {n: d for n, d in self.shown.items() if self.states[n].light_factor() > 0}
        factors = {n: self.states[n].light_factor() for n in drives}
        return self.radiance_of(view, drives, factors, bands, blur_px)

    def radiance_of(
        self,
        view: View,
        drives: Mapping[str, Image],
        factors: Mapping[str, float],
        bands: slice,
        blur_px: float,
    ) -> Image:
        """Radiance (H, W, C) of given drives; `factors` is each projector's share of full light."""
        channels = len(range(*bands.indices(3)))
        patches = len(self.room.area_m2)
        flux = np.zeros((patches, channels))
        direct = np.zeros((*view.albedo.shape, channels), np.float32)
        for name, drive in drives.items():
            light = self.lights[name]
            irradiance = light.emit(drive, bands) * np.float32(factors[name])
            flux += light.patch_flux(irradiance, patches)
            direct += view.direct(name, light.blurred(irradiance, blur_px))
        return direct + view.scattered(self.room, self.room.irradiance(flux))

    def camera_view(self, name: str) -> View:
        """The lines of sight of a camera, prepared once."""
        if name not in self._views:
            camera = self.cameras[name]
            width, height = camera.size
            pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
            rays = unproject(pixels, camera.lens)
            in_circle = camera_circle(camera)
            rays = np.where(in_circle[..., None], rays, np.nan)
            back = camera.camera_from_dome.inverse()
            self._views[name] = View.along(
                self.room, self.lights, back.translation, back.rotate(rays)
            )
        return self._views[name]

    def noise_stream(self, camera: str, settings: CameraSettings) -> np.random.Generator:
        """Noise that depends on what is photographed, not on when: a resumed run repeats it.

        The same picture taken again in one run gets fresh noise.
        """
        digest = zlib.crc32(repr((camera, settings)).encode())
        for name in sorted(self.shown):
            factor = self.states[name].light_factor()
            digest = zlib.crc32(f"{name} {factor:.6f}".encode(), digest)
            if factor:
                digest = zlib.crc32(np.ascontiguousarray(self.shown[name]).data, digest)
        repeat = self._repeats.get(digest, 0)
        self._repeats[digest] = repeat + 1
        return np.random.Generator(np.random.SFC64([self.seed, digest, repeat]))


def camera_circle(camera: CameraBuild) -> NDArray[np.bool_]:
    """Pixels (H, W) that the lens's image circle reaches; all of them for a pinhole."""
    width, height = camera.size
    if camera.lens.kind == "brown":
        return np.ones((height, width), dtype=bool)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    centre = camera.lens.centre
    return np.asarray(np.hypot(x - centre[0], y - centre[1]) <= min(width, height) / 2)
