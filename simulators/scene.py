"""The one scene that all devices of a simulated venue share."""

import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from procam.arrays import BoolArray, Image
from procam.errors import InputError
from procam.model.frame import CameraSettings
from simulators.builds import CameraBuild, ProjectorBuild, same_geometry
from simulators.clock import SceneClock
from simulators.placement import place_cameras, place_projectors
from simulators.presets import Overrides, Preset
from simulators.projector_light import AnySurface, ProjectorLight
from simulators.projector_state import ProjectorState
from simulators.sight_lines import SightLines
from simulators.surface import Surface
from simulators.transport import Room
from simulators.wall_placement import place_wall_cameras, place_wall_projectors
from simulators.walled_room import WalledRoom, WalledSurface

GREEN = slice(1, 2)
ALL_BANDS = slice(0, 3)


@dataclass(frozen=True)
class SceneSize:
    """How many devices and how fine; `rays` per patch is a power of two.

    `map_size` is only written to venue.toml, of whose dome maps it is the edge [px].
    """

    projectors: int = 2
    projector_size: tuple[int, int] = (1280, 800)
    cameras: int = 1
    camera_size: tuple[int, int] = (1600, 1600)
    camera_kind: str = "fisheye"
    rays: int = 2048
    map_size: int | None = None


@dataclass(frozen=True)
class Devices:
    """Projectors and cameras as they are built and installed; another `session` has other noise."""

    projectors: Sequence[ProjectorBuild]
    cameras: Sequence[CameraBuild]
    session: int = 0


class DomeScene:
    """Screen, room, projectors and cameras, and the present picture of each projector.

    Parameters
    ----------
    like : a scene of the same dome, whose rays, lenses and shapes are used again where they are the
        same.
    devices : those of `like` as they are after a drift; None for those that the screen places.
    surface : walls in place of the preset's dome.
    """

    def __init__(
        self,
        preset: Preset,
        size: SceneSize,
        seed: int,
        like: "DomeScene | None" = None,
        devices: Devices | None = None,
        surface: WalledSurface | None = None,
    ) -> None:
        self.preset, self.size, self.seed = preset, size, seed
        self.undrifted: DomeScene = like.undrifted if like and devices else self
        self.clock = SceneClock()
        shape = surface or (like.surface if like else Surface.build(preset))
        self.surface: AnySurface = replace(shape, preset=preset)
        devices = devices or _placed(size, self.surface)
        builds, self.session = devices.projectors, devices.session
        self._like = like
        if like is None:
            with ThreadPoolExecutor(2) as pool:
                room = pool.submit(_traced, self.surface, size.rays)
                lights = pool.map(lambda build: ProjectorLight.on(self.surface, build), builds)
                self.lights = {light.build.name: light for light in lights}
                self.room = room.result()
        else:
            self.room = like.room.repainted(self.surface)  # type: ignore[arg-type] # of its own kind
            self.lights = {
                b.name: like.lights[b.name].altered(b, like.surface, self.surface) for b in builds
            }
        self.cameras = {camera.name: camera for camera in devices.cameras}
        self.states = {b.name: ProjectorState(self.clock, features=b.features) for b in builds}
        black = np.zeros((size.projector_size[1], size.projector_size[0], 3), np.float32)
        self.shown: dict[str, Image] = dict.fromkeys(self.lights, black)
        self._before: dict[str, tuple[Image, float]] = {}  # and the time when it ends [s]
        self._lines: dict[str, SightLines] = {}
        self._repeats: dict[int, int] = {}

    def altered(self, **overrides: Unpack[Overrides]) -> "DomeScene":
        """The venue with overrides on top of its own, in standby; no ray is traced again."""
        if self.undrifted is not self:
            raise InputError(
                "a venue that has drifted takes no overrides: set them before it drifts"
            )
        return DomeScene(self.preset.altered(**overrides), self.size, self.seed, like=self)

    def show(self, name: str, drive: Image) -> None:
        """Give a projector another picture (H, W, 3)."""
        delay_s = self.lights[name].build.features.picture_delay_s
        if delay_s:
            self._before[name] = self.on_screen(name), self.clock.now_s() + delay_s
        self.shown[name] = drive
        self.states[name].follow(float(drive.mean()))

    def on_screen(self, name: str) -> Image:
        """The picture (H, W, 3) that a projector has on the screen by now."""
        before, until_s = self._before.get(name, (self.shown[name], 0.0))
        return before if self.clock.now_s() < until_s else self.shown[name]

    def radiance(self, lines: SightLines, bands: slice, blur_px: float) -> Image:
        """Radiance (H, W, C) [full scale/s] of the present pictures along lines of sight."""
        drives = {n: self.on_screen(n) for n in self.shown if self.states[n].light_factor() > 0}
        factors = {n: self.states[n].light_factor() for n in drives}
        return self.radiance_of_drives(lines, drives, factors, bands, blur_px)

    def radiance_of_drives(
        self,
        lines: SightLines,
        drives: Mapping[str, Image],
        factors: Mapping[str, float],
        bands: slice,
        blur_px: float,
    ) -> Image:
        """Radiance (H, W, C) of given drives; `factors` is each projector's share of full light."""
        return np.add(*self.parts_of_drives(lines, drives, factors, bands, blur_px))

    def parts_of_drives(
        self,
        lines: SightLines,
        drives: Mapping[str, Image],
        factors: Mapping[str, float],
        bands: slice,
        blur_px: float,
    ) -> tuple[Image, Image]:
        """Direct and scattered light (H, W, C) of given drives, whose sum is `radiance_of_drives`."""
        irradiances = {
            name: self.lights[name].emit(drive, bands) * np.float32(factors[name])
            for name, drive in drives.items()
        }
        return self._parts(lines, irradiances, len(range(*bands.indices(3))), blur_px)

    def radiance_of_irradiances(
        self, lines: SightLines, irradiances: Mapping[str, Image], channels: int, blur_px: float
    ) -> Image:
        """Radiance (H, W, C) of projectors' irradiance images (H, W, C) along lines of sight."""
        return np.add(*self._parts(lines, irradiances, channels, blur_px))

    def _parts(
        self, lines: SightLines, irradiances: Mapping[str, Image], channels: int, blur_px: float
    ) -> tuple[Image, Image]:
        patches = len(self.room.area_m2)
        flux = np.zeros((patches, channels))
        for name, irradiance in irradiances.items():
            flux += self.lights[name].patch_flux(irradiance, patches)
        scattered = lines.scattered(self.room, self.room.irradiance(flux))
        direct = np.zeros_like(scattered)
        for name, irradiance in irradiances.items():
            direct += lines.direct(name, self.lights[name].blurred(irradiance, blur_px))
        preset = self.preset
        if preset.ambient:
            ambient = preset.ambient * preset.brightness * preset.albedo
            scattered[lines.on_screen] += np.float32(ambient)
        return direct, scattered

    def sight_lines(self, name: str) -> SightLines:
        """The lines of sight of a camera, prepared once."""
        if name not in self._lines:
            camera, like = self.cameras[name], self._like
            if like is None or not same_geometry(camera, like.cameras[name]):
                self._lines[name] = self._traced_lines(camera)
            else:
                self._lines[name] = self._lines_like(like, name)
        return self._lines[name]

    def _traced_lines(self, camera: CameraBuild) -> SightLines:
        width, height = camera.size
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
        rays = np.where(camera_circle(camera)[..., None], camera.rays(pixels), np.nan)
        back = camera.camera_from_dome.inverse()
        return SightLines.along(self.room, self.lights, back.translation, back.rotate(rays))

    def _lines_like(self, like: "DomeScene", name: str) -> SightLines:
        """The lines of sight of a camera that has not moved since `like`."""
        moved = {
            n: light
            for n, light in self.lights.items()
            if not same_geometry(light.build, like.lights[n].build)
        }
        lines = like.sight_lines(name).repainted(like.surface, self.surface)
        return lines.with_lights(moved, self.surface) if moved else lines

    def noise_stream(self, camera: str, settings: CameraSettings) -> np.random.Generator:
        """Noise that depends on the picture, not on the time, so that a resumed run repeats it.

        The same picture taken again in one run gets fresh noise.
        """
        digest = zlib.crc32(repr((camera, settings)).encode())
        for name in sorted(self.shown):
            factor = self.states[name].light_factor()
            digest = zlib.crc32(f"{name} {factor:.6f}".encode(), digest)
            if factor:
                digest = zlib.crc32(np.ascontiguousarray(self.on_screen(name)).data, digest)
        repeat = self._repeats.get(digest, 0)
        self._repeats[digest] = repeat + 1
        # the last 0 of an entropy changes no number of its stream
        entropy = [self.seed, digest, repeat, self.session]
        return np.random.Generator(np.random.SFC64(entropy))


def _traced(surface: AnySurface, rays: int) -> Room:
    if isinstance(surface, Surface):
        return Room.trace(surface, rays)
    return WalledRoom.trace(surface, rays)


def _placed(size: SceneSize, surface: AnySurface) -> Devices:
    """The projectors and cameras of a screen."""
    preset = surface.preset
    if isinstance(surface, Surface):
        placed = place_projectors(size.projectors, size.projector_size, preset)
        cameras = place_cameras(size.cameras, size.camera_size, size.camera_kind, preset)
    else:
        placed = place_wall_projectors(surface, size.projectors, size.projector_size)
        cameras = place_wall_cameras(surface, size.cameras, size.camera_size)
    _check_names(preset, [build.name for build in placed])
    return Devices([_with_overrides(build, preset) for build in placed], cameras)


def _check_names(preset: Preset, names: list[str]) -> None:
    unknown = [name for name, _ in preset.features if name not in names]
    if unknown:
        raise InputError(f"features: projector {unknown[0]} is not one of {', '.join(names)}")


def _with_overrides(build: ProjectorBuild, preset: Preset) -> ProjectorBuild:
    defocus_px = build.defocus_px if preset.defocus_px is None else preset.defocus_px
    features = dict(preset.features).get(build.name, build.features)
    gamma = build.gamma * preset.gamma_left
    return replace(build, defocus_px=defocus_px, gamma=gamma, features=features)


def camera_circle(camera: CameraBuild) -> BoolArray:
    """Pixels (H, W) inside the lens's image circle; all of them for a pinhole."""
    width, height = camera.size
    if camera.lens.kind == "brown":
        return np.ones((height, width), dtype=bool)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    centre = camera.lens.centre
    return np.asarray(np.hypot(x - centre[0], y - centre[1]) <= min(width, height) / 2)
