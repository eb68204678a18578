"""Entries of calibration.json as models, and checks of its maps: they may be damaged, or of another program.

What is wrong is raised as ValueError; `load_calibration` adds the file's name and what to do.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from procam.arrays import AnyArray, Array, FloatArray
from procam.files.names import NAME_PATTERN
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.model.correspondence import ProjectorSurface
from procam.model.optics import CameraModel, Sensor
from procam.model.photometry import AbsoluteColour, ResponseCurve
from procam.model.quality import Figure, Goal
from procam.model.screen import ContentCanvas, Dome, RoomScreen, Screen
from procam.model.transport import Measured, ScatterKernel

if TYPE_CHECKING:
    from procam.maths.mesh.rooms import Room

# what reading a document raises that is damaged, or of another program
DAMAGES = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
Bounds = tuple[float, float]
ANY: Bounds = (-1e9, 1e9)  # of lengths, angles and pixels: wider than any rig
POSITIVE: Bounds = (1e-9, 1e9)
SHARE: Bounds = (0.0, 1.0)
EXTENT: Bounds = (
    0.0,
    1e4,
)  # [m] of a flat screen too; dimensions are checked where a room is made of them
ROOMS = ("box", "cylinder", "mesh")
MOST_MOVED_M = 1.0  # of a wall: more is another room
ANGLE: Bounds = (-2 * np.pi, 2 * np.pi)
FIELD_OF_VIEW: Bounds = (0.1, 2 * np.pi)
PIXELS: Bounds = (1, 65536)
UNIT_LENGTH = 1e-3  # departure of a direction's length from 1
TURN = 1e-6  # departure of a rotation from an orthonormal matrix


def numbers(
    entry: Mapping[str, Any],
    key: str,
    shape: tuple[int | None, ...],
    bounds: Bounds = ANY,
    *,
    unknown: bool = False,
) -> Array:
    """`entry[key]` as an array of that shape, None for any length; NaN only where it is `unknown`."""
    if isinstance(entry[key], bool):
        raise ValueError(f"{key} is {entry[key]} where a number belongs")
    found = np.array(entry[key], float)
    fits = found.ndim == len(shape) and all(
        n in (None, m) for n, m in zip(shape, found.shape, strict=True)
    )
    if not fits:
        there, wanted = (_times(lengths) for lengths in (found.shape, shape))
        raise ValueError(f"{key} has {there} numbers where {wanted} belong")
    inside = (found >= bounds[0]) & (found <= bounds[1]) | np.isnan(found) & unknown
    if not inside.all():
        raise ValueError(
            f"{key} is {found[~inside].flat[0]:g} where {bounds[0]:g} to {bounds[1]:g} belong"
        )
    return found


def number(entry: Mapping[str, Any], key: str, bounds: Bounds = ANY) -> float:
    """`entry[key]` as a number within bounds."""
    return float(numbers(entry, key, (), bounds))


def size_of(entry: Mapping[str, Any]) -> tuple[int, int]:
    """(width, height) [px]."""
    width, height = numbers(entry, "size", (2,), PIXELS)
    return int(width), int(height)


def check_rotation(rotation: Array) -> None:
    """Refuse a matrix (3, 3) that does more than turn."""
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > TURN or np.linalg.det(rotation) < 0:
        raise ValueError("rotation is no rotation matrix")


def _times(lengths: tuple[int | None, ...]) -> str:
    return " x ".join("any" if n is None else str(n) for n in lengths) or "1"


def screen(entry: dict[str, Any], mesh: "Room | None" = None) -> Screen:
    """The screen: a dome where nothing else is said, as in files of schema 1; `mesh` of what is one."""
    if entry.get("kind", "dome") != "dome":
        return _room(entry, mesh)
    return Dome(
        number(entry, "radius_m", POSITIVE),
        number(entry, "half_angle"),
        number(entry, "tilt"),
        number(entry, "floor_albedo", SHARE),
        number(entry, "floor_albedo_sigma"),
        tuple(numbers(entry, "bumps", (None,)).tolist()) if entry.get("bumps") else (),
        int(number(entry, "degree")) if "degree" in entry else 0,
    )


def _room(entry: dict[str, Any], mesh: "Room | None") -> RoomScreen:
    lit, size = tuple(map(str, entry["lit"])), numbers(entry, "size", (3,), EXTENT).tolist()
    others = [
        (str(n), *numbers({"albedo": pair}, "albedo", (2,), SHARE).tolist())
        for n, *pair in entry["others"]
    ]
    if mesh is not None:
        drawn = RoomScreen.of_mesh(mesh, lit, tuple(others))
        if drawn.digest != entry["digest"]:
            raise ValueError("its mesh is another one, or altered")
    else:
        drawn = RoomScreen(str(entry["kind"]), (size[0], size[1], size[2]), lit, tuple(others))
    if drawn.kind not in ROOMS or set(lit) | {n for n, *_ in others} != set(drawn.room.names):
        raise ValueError(
            f"a screen of kind {drawn.kind[:40]!r} with the parts {lit} is none that procam makes"
        )
    return _with_moved(drawn, entry.get("moved", []))


def _with_moved(drawn: RoomScreen, entries: list[Any]) -> RoomScreen:
    """The room with walls that are not where they were drawn."""
    if not entries:
        return drawn
    moved = {
        str(name): tuple(numbers({"moved": by}, "moved", (7,), ANY).tolist())
        for name, by in entries
    }
    if len(moved) != len(entries) or not set(moved) <= set(drawn.lit):
        raise ValueError(f"moved walls {list(moved)} are not some of the lit {list(drawn.lit)}")
    found = replace(drawn, moved=tuple(moved.items()))
    if np.abs(found.room.vertices - drawn.room.vertices).max() > MOST_MOVED_M:
        raise ValueError(f"walls moved by more than {MOST_MOVED_M:g} m")
    return found


def safe_name(name: str) -> str:
    """A name that is a part of file names."""
    if not re.fullmatch(NAME_PATTERN, name):
        raise ValueError(f"{name[:40]!r} is no name that procam gives")
    return name


def scatter_kernel(entry: dict[str, Any]) -> ScatterKernel:
    """The scatter kernel."""
    matrix, profile = (
        numbers(entry, "matrix", (3, None, None)),
        numbers(entry, "profile", (3, None)),
    )
    return ScatterKernel(int(number(entry, "degree")), matrix, profile)


def _sensor(entry: dict[str, Any]) -> Sensor:
    near = numbers(entry, "near_glare", (None, 2), SHARE) if entry.get("near_glare") else ()
    return Sensor(
        int(number(entry, "bits", (1, 16))),
        number(entry, "black_level"),
        tuple(numbers(entry, "vignetting", (None,)).tolist()),
        number(entry, "glare", SHARE),
        number(entry, "glare_sigma", SHARE),
        tuple((float(share), float(spread)) for share, spread in near),
    )


def camera(name: str, entry: dict[str, Any]) -> CameraModel:
    """A camera."""
    return CameraModel(
        name,
        size_of(entry),
        lens(entry["lens"]),
        _sensor(entry["sensor"]),
        pose(entry["camera_from_dome"]),
        numbers(entry, "pupil", (2,)) if "pupil" in entry else np.zeros(2),
    )


def main_camera(document: Mapping[str, Any]) -> str:
    """The camera that light was measured with; "" if a calibration of several does not record it."""
    names = list(document["cameras"])
    name = document.get("main_camera", names[0] if len(names) == 1 else "")
    if name not in [*names, ""]:
        raise ValueError(f"main_camera {name!r} is none of its cameras")
    return str(name)


def absolute(document: Mapping[str, Any]) -> AbsoluteColour | None:
    """What content light is in cd/m2; None of a calibration that no meter has made absolute."""
    entry = document.get("absolute")
    if entry is None:
        return None
    covariance = numbers(entry, "covariance", (9, 9))
    if (np.diag(covariance) < 0).any():
        raise ValueError("covariance of absolute has variances below 0")
    return AbsoluteColour(numbers(entry, "xyz_from_content", (3, 3)), covariance)


def canvas(document: Mapping[str, Any], of: Screen) -> ContentCanvas:
    """The canvas that content is drawn on."""
    if isinstance(of, RoomScreen):
        return of.canvas
    entry = document.get("canvas")
    if entry is None:
        return _canvas_of_server(document["projectors"])
    return Canvas(number(entry, "fov", FIELD_OF_VIEW), number(entry, "rotation", ANGLE))


def _canvas_of_server(projectors: Mapping[str, Any]) -> Canvas:
    """The canvas of files without one: a media server is a fisheye at the dome's centre."""
    devices = [*projectors.values()]
    if len(devices) != 1 or devices[0]["lens"]["kind"] != "kannala-brandt":
        return STANDARD
    optics, place = lens(devices[0]["lens"]), pose(devices[0]["projector_from_dome"])
    fov = size_of(devices[0])[0] / float(optics.focal[0])
    rotation = float(np.arctan2(place.rotation[0, 0], -place.rotation[0, 1]))
    standard = np.allclose([fov, rotation], [STANDARD.fov, STANDARD.rotation], atol=1e-9)
    return STANDARD if standard or place.translation.any() else Canvas(fov, rotation)


def response(entry: dict[str, Any]) -> ResponseCurve:
    """A projector's response."""
    levels = numbers(entry, "levels", (None,), SHARE)
    if not (np.diff(levels) > 0).all():
        raise ValueError("levels of a response do not rise")
    values, sigma = (numbers(entry, key, (len(levels), 3)) for key in ("values", "sigma"))
    return ResponseCurve(levels, values, sigma)


def lens(entry: dict[str, Any]) -> Lens:
    """A lens."""
    terms = {"brown": 5, "kannala-brandt": 4}[entry["kind"]]
    return Lens(
        entry["kind"],
        numbers(entry, "focal", (2,), POSITIVE),
        numbers(entry, "centre", (2,)),
        numbers(entry, "distortion", (terms,)),
    )


def pose(entry: dict[str, Any]) -> Pose:
    """A pose."""
    rotation = numbers(entry, "rotation", (3, 3))
    check_rotation(rotation)
    return Pose(rotation, numbers(entry, "translation", (3,)))


def measured(entry: dict[str, Any]) -> Measured:
    """Values of three channels with their sigma; NaN stands for what was not measured."""
    return Measured(*(numbers(entry, key, (3,), unknown=True) for key in ("value", "sigma")))


def figure(entry: dict[str, Any]) -> Figure:
    """A figure of the quality."""
    goal = None if entry["goal"] is None else Goal(**entry["goal"])
    return Figure(
        entry["value"], entry["unit"], goal, entry["samples"], entry["note"], entry.get("sigma")
    )


def check_surface(surface: ProjectorSurface, size: tuple[int, int], blend: FloatArray) -> None:
    """Refuse maps of another size than the panel's, directions of another length than 1, areas below 0."""
    shape = size[::-1]
    for name, layer in (("direction", surface.direction), ("blend", blend)):
        if layer.shape[:2] != shape:
            raise ValueError(f"map {name} has {layer.shape[:2]} pixels where the panel has {shape}")
    length = np.linalg.norm(surface.direction[surface.valid], axis=-1)
    if not (np.abs(length - 1) < UNIT_LENGTH).all():
        raise ValueError("map direction has vectors whose length is not 1")
    if not (surface.solid_angle_sr[surface.valid] >= 0).all():
        raise ValueError("map solid_angle is negative or NaN at lit pixels")
    if not ((blend >= -UNIT_LENGTH) & (blend <= 1 + UNIT_LENGTH)).all():
        raise ValueError("map blend has values outside 0 to 1")


def check_maps(maps: Mapping[str, AnyArray], of: Screen) -> None:
    """Refuse maps of a screen that are not of one size, the canvas's, or not of shares."""
    shapes = {layer.shape[:2] for layer in maps.values()}
    needed = of.canvas.shape(max(width for _, width in shapes))
    if shapes != {needed}:
        raise ValueError(f"maps of the screen have the sizes {sorted(shapes)}; {needed} is needed")
    if not (maps["coverage"] >= -UNIT_LENGTH).all():  # above 1 is for the compensator to say
        raise ValueError("map coverage has values below 0, or NaN")
