"""The truth about a simulated venue, in the calibration-directory format, for the judge alone.

The files are those of `procam.files.calibration`, written after a run has ended, with code of their own:
reader and writer are not shared with procam, so a mistake in either shows. The light of full white and
black is split into direct and scattered light on a dome master; feedback and albedo are their means.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import OpenImageIO as oiio

from procam.arrays import AnyArray, Array, Image
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from simulators.backend import build_scene, build_server
from simulators.builds import CameraBuild, ProjectorBuild
from simulators.mitsuba_venue import PathTracedRoom
from simulators.projector_light import ProjectorLight
from simulators.scene import ALL_BANDS, DomeScene
from simulators.server import NAME as SERVER
from simulators.server import MediaServer, projector_drives
from simulators.sight_lines import SightLines
from simulators.surface import Surface

MASTER = 1024
PATHS = 8192  # from each patch: 0.2 % of the scattered light, half a minute a picture
WHEN = "1980:01:01 00:00:00"  # in headers, so that the same venue gives the same bytes
FINE = 2  # pictures are rendered this much finer and averaged over pixels
RGB = ("R", "G", "B")


def write_truth(
    settings: Mapping[str, Any],
    venue_dir: Path,
    out: Path,
    pictures: Mapping[str, Mapping[str, Image]],
    judge: Literal["rays", "mitsuba"] = "rays",
) -> None:
    """Write the truth of a simulated venue to `out`.

    `pictures` are sets of projector drives (H, W, 3) by picture and projector; for each,
    OUT/pictures/NAME.exr holds the radiance on the dome without camera or noise, OUT/scattered/NAME.exr
    its scattered part. `judge` is the source of inter-reflection: the scene's own flux tracing, or
    Mitsuba's path tracer.
    """
    scene = build_scene(settings, venue_dir)
    if judge == "mitsuba":
        scene.room = PathTracedRoom.of(scene.room, PATHS)
    server = build_server(scene, settings, venue_dir)
    (out / "maps").mkdir(parents=True)
    document = _write_maps(scene, server, out / "maps")
    (out / "calibration.json").write_text(json.dumps(document, indent=1))
    if pictures:
        _write_pictures(scene, server, pictures, out)


def _write_pictures(
    scene: DomeScene,
    server: MediaServer | None,
    pictures: Mapping[str, Mapping[str, Image]],
    folder: Path,
) -> None:
    lines = _master_lines(scene, FINE * MASTER)
    for where in ("pictures", "scattered"):
        (folder / where).mkdir()
    for name, drives in pictures.items():
        sent = projector_drives(server, drives)
        full = dict.fromkeys(sent, 1.0)
        direct, scattered = scene.parts_of_drives(lines, sent, full, ALL_BANDS, 0)
        for where, light in ("pictures", direct + scattered), ("scattered", scattered):
            picture = _averaged(light)
            channels = {c: picture[..., i] for i, c in enumerate(RGB)}
            _write_exr(folder / where / f"{name}.exr", channels)


def _write_maps(scene: DomeScene, server: MediaServer | None, folder: Path) -> dict[str, Any]:
    """Write the maps of dome and projectors; returns calibration.json."""
    white, black = (_uniform_drives(scene, server, level) for level in (1.0, 0.0))
    view = _master_lines(scene, MASTER)
    direct_white, scattered = _split(scene, view, white)
    direct_black, _ = _split(scene, view, black)
    coverage = _coverage(scene)
    solid = master_solid_angles(MASTER) * coverage
    flux = np.tensordot(solid, direct_white, 2)
    feedback = np.tensordot(solid, scattered, 2) / flux
    # without inter-reflection the albedo is 0
    albedo_seen = view.albedo * np.float32(scene.preset.bounces)
    albedo = np.tensordot(solid, albedo_seen, 2) / solid.sum()
    dome = {"coverage": coverage}
    for i, c in enumerate(RGB):
        dome[f"scatter_per_flux.{c}"] = scattered[..., i] / flux[i]
        dome[f"albedo.{c}"] = albedo_seen
        dome[f"lo.{c}"], dome[f"hi.{c}"] = direct_black[..., i], direct_white[..., i]
    _write_exr(folder / "dome.exr", dome)
    if server:
        _write_exr(folder / f"{SERVER}.exr", _server_maps(server, direct_white))
    else:
        for name, light in scene.lights.items():
            _write_exr(folder / f"{name}.exr", _projector_maps(light, view))
    return _document(scene, server, feedback, np.full(3, albedo))


def _uniform_drives(
    scene: DomeScene, server: MediaServer | None, level: float
) -> Mapping[str, Image]:
    """Drives of the projectors for a uniform picture of one level."""
    if server:
        return server.frames(np.full((server.size, server.size, 3), level, np.float32))
    return {n: np.full_like(d, level) for n, d in scene.shown.items()}


def _master_lines(scene: DomeScene, size: int) -> SightLines:
    """Lines of sight from the dome's centre, one per pixel of a dome master."""
    direction, inside = master_directions(size)
    rays = np.where(inside[..., None], direction, np.nan)
    return SightLines.along(scene.room, scene.lights, np.zeros(3), rays)


def _split(scene: DomeScene, view: SightLines, drives: Mapping[str, Image]) -> tuple[Image, Image]:
    patches = len(scene.room.area_m2)
    flux, direct = np.zeros((patches, 3)), np.zeros((*view.albedo.shape, 3), np.float32)
    for name, drive in drives.items():
        light = scene.lights[name]
        irradiance = light.emit(drive, ALL_BANDS)
        flux += light.patch_flux(irradiance, patches)
        direct += view.direct(name, irradiance)
    return direct, view.scattered(scene.room, scene.room.irradiance(flux))


def _coverage(scene: DomeScene) -> Image:
    """Share (N, N) of each master pixel that some projector lights, from a finer picture."""
    view = _master_lines(scene, FINE * MASTER)
    lit = np.zeros(view.albedo.shape, np.float32)
    for name, light in scene.lights.items():
        mask = light.lit.astype(np.float32)[..., None]
        gain = view.sources[name][1]
        seen = view.direct(name, mask)[..., 0]
        lit = np.maximum(lit, np.where(gain > 0, seen / np.maximum(gain, 1e-9), 0) >= 0.5)
    return _averaged(lit[..., None])[..., 0]


def _averaged(fine: Image) -> Image:
    height, width, channels = fine.shape
    blocks = fine.reshape(height // FINE, FINE, width // FINE, FINE, channels)
    return np.asarray(blocks.mean(axis=(1, 3)), np.float32)


def _projector_maps(light: ProjectorLight, view: SightLines) -> dict[str, AnyArray]:
    white = light.build.colour_mix.sum(axis=1)
    valid = light.lit.astype(np.float32)
    albedo = light.reflected_m2 / np.maximum(light.solid_angle_sr, 1e-30)
    albedo = albedo / np.median(albedo) * np.median(view.albedo[view.on_screen])
    gain = (light.irradiance * albedo)[..., None] * white
    return _maps(light.direction, light.solid_angle_sr, valid, gain)


def _server_maps(server: MediaServer, white: Image) -> dict[str, AnyArray]:
    """Channels of the server's map; `white` (M, M, 3) is the direct radiance of full white."""
    direction, reached = server.pixel_directions()
    valid = reached.astype(np.float32)
    at = master_pixels(direction, white.shape[0]).astype(np.float32)
    gain = cv2.remap(white, at, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
    return _maps(
        direction, master_solid_angles(server.size, server.fov), valid, gain * valid[..., None]
    )


def _maps(direction: Array, solid_angle_sr: Array, valid: Image, gain: Array) -> dict[str, Any]:
    """Channels of a map of the calibration format, by name."""
    return {
        **{f"direction.{axis}": direction[..., i] for i, axis in enumerate("xyz")},
        "solid_angle": solid_angle_sr,
        "sigma_arcmin": np.zeros_like(valid),
        "valid": valid,
        "measured": valid,
        "blend": valid,
        **{f"gain.{c}": gain[..., i] for i, c in enumerate(RGB)},
    }


def _document(
    scene: DomeScene, server: MediaServer | None, feedback: Array, albedo: Array
) -> dict[str, Any]:
    preset, surface = scene.preset, scene.surface
    assert isinstance(surface, Surface)
    builds = {n: light.build for n, light in scene.lights.items()}
    projectors = {n: _projector(build) for n, build in builds.items()}
    if server:
        projectors = {SERVER: {**next(iter(projectors.values())), **_server_device(server)}}
    return {
        "schema_version": 1,
        "screen": {
            "radius_m": preset.radius_m,
            "half_angle": surface.half_angle,
            "tilt": float(np.radians(preset.tilt_deg)),
            "floor_albedo": preset.floor_albedo,
            "floor_albedo_sigma": 0.0,
        },
        "cameras": {n: _camera(c, preset.glare) for n, c in scene.cameras.items()},
        "projectors": projectors,
        "feedback": {"value": feedback.tolist(), "sigma": [0.0] * 3},
        "albedo": {"value": albedo.tolist(), "sigma": [0.0] * 3},
        "content_from_camera": np.eye(3).tolist(),
        "quality": {},
        "provenance": {"source": "simulated truth", "seed": scene.seed},
    }


def _camera(camera: CameraBuild, glare: float) -> dict[str, Any]:
    return {
        "size": list(camera.size),
        "lens": _lens(camera),
        "sensor": {
            "bits": camera.bits,
            "black_level": camera.black_level,
            "vignetting": list(camera.vignetting),
            "glare": glare,
            "glare_sigma": 0.0,
        },
        "camera_from_dome": _pose(camera.camera_from_dome),
    }


def _projector(build: ProjectorBuild) -> dict[str, Any]:
    levels = np.linspace(0, 1, 257)
    values = build.response(levels)
    mix = build.colour_mix / build.colour_mix.sum(axis=1, keepdims=True)
    return {
        "size": list(build.size),
        "lens": _lens(build),
        "projector_from_dome": _pose(build.projector_from_dome),
        "covariance": None,
        "response": {
            "levels": levels.tolist(),
            "values": values.tolist(),
            "sigma": np.zeros_like(values).tolist(),
        },
        "colour_mix": mix.tolist(),
    }


def _server_device(server: MediaServer) -> dict[str, Any]:
    """Size, lens and pose of the server: an equidistant fisheye at the dome's centre."""
    middle = (server.size - 1) / 2
    from_pole = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return {
        "size": [server.size, server.size],
        "lens": {
            "kind": "kannala-brandt",
            "focal": [server.size / server.fov] * 2,
            "centre": [middle] * 2,
            "distortion": [0.0] * 4,
        },
        "projector_from_dome": {
            "rotation": (from_pole @ server.turn.T).tolist(),
            "translation": [0.0] * 3,
        },
    }


def _lens(device: CameraBuild | ProjectorBuild) -> dict[str, Any]:
    lens = device.lens
    return {
        "kind": lens.kind,
        "focal": lens.focal.tolist(),
        "centre": lens.centre.tolist(),
        "distortion": lens.distortion.tolist(),
    }


def _pose(pose: Any) -> dict[str, Any]:
    return {"rotation": pose.rotation.tolist(), "translation": pose.translation.tolist()}


def _write_exr(path: Path, channels: Mapping[str, AnyArray]) -> None:
    stack = np.stack([np.asarray(c, np.float32) for c in channels.values()], axis=-1)
    height, width, count = stack.shape
    spec = oiio.ImageSpec(width, height, count, "float")
    spec.channelnames = tuple(channels)
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", WHEN)
    output = oiio.ImageOutput.create(str(path))
    assert output is not None, oiio.geterror()
    output.open(str(path), spec)
    output.write_image(np.ascontiguousarray(stack))
    output.close()
