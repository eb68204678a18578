"""The mesh of a room from an OBJ file: its groups are parts, its texture coordinates places on the canvas."""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.errors import FileFormatError
from procam.files.meshes import Surface, checked
from procam.maths.mesh.canvas import rasterised_share
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.raycast import MeshTracer
from procam.maths.mesh.rooms import BOX, CYLINDER, Room
from procam.maths.mesh.shape import seen_faces
from procam.maths.mesh.subdivision import subdivided

EXTRA = 'pip install "procam[geom]"'
LARGEST_M = 500.0
MOST_FACES = 100_000  # whose form factors fit into 1.5 GB
FACES = 6000  # of a mesh of few, about
HIDDEN = 0.01  # of a lit part's area: what the origin may not see of it
OVERLAP = 0.02  # of the area of texture islands: rounding of pixels, at most
OUTSIDE = 1e-6  # of texture coordinates
MIRRORED = 0.01  # of the lit area
GEOMETRY = ("v", "vt", "f")
USUAL = {*BOX, *CYLINDER}
NUMBERS = re.compile(r"[-+0-9.eE/]+|[-+]?(?:nan|inf)", re.IGNORECASE)


@dataclass(frozen=True)
class MeshFile:
    """What venue.toml says of an OBJ file.

    Attributes
    ----------
    lit : names of groups that projectors light. canvas : width and height of the pictures that texture
        coordinates were made for [px].
    origin_m : a point of the mesh from which all that is lit can be seen. smooth : see `Room`.
    """

    path: Path
    lit: tuple[str, ...]
    canvas: tuple[int, int]
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    smooth: bool = False


def read_room(file: MeshFile) -> Room:
    """The room of a file, about its origin; faces are cut to about `FACES`.

    Raises
    ------
    FileFormatError
        There is no such file or it is damaged; the surface is not fit, see `meshes.checked`; parts that are
        lit do not exist, have no place on the canvas, overlap there or are mirrored; or the origin does not
        see them.
    """
    surface, names = _read(file.path)
    _check_numbers(surface)
    surface = replace(surface, vertices=surface.vertices - np.array(file.origin_m))
    surface = checked(surface)
    lit = _lit_faces(surface, names, file.lit)
    _check_texture(surface, names, lit)
    room = _room(surface, names, lit, file)
    _check_overlap(surface, room)
    _check_sight(surface, room, file)
    return room


def _read(path: Path) -> tuple[Surface, tuple[str, ...]]:
    """The surface of a file, polygons as triangles, and the names of its parts."""
    if path.suffix.lower() != ".obj":
        raise FileFormatError(f"{path}: meshes are read from .obj files; export it as one")
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; a mesh is needed. Check the name")
    loader = _trimesh()
    try:
        text, groups = geometry_text(path)
        scene = loader.load_scene(
            io.StringIO(text), "obj", process=False, split_groups=groups, split_objects=not groups
        )
        parts = dict(sorted(scene.geometry.items()))
        if not any(len(getattr(part, "faces", ())) for part in parts.values()):
            raise ValueError("it has no faces")
        if any(part.vertices.shape[1:] != (3,) for part in parts.values()):
            raise ValueError("its points have no three coordinates")
        return _joined(path, list(parts.values())), tuple(map(_part_name, parts))
    except Exception as error:  # trimesh raises of every kind
        raise FileFormatError(
            f"{path} is not a readable OBJ mesh ({' '.join(str(error).split())}); export it again"
        ) from error


def _trimesh() -> Any:
    try:
        import trimesh  # noqa: PLC0415
    except ImportError as error:
        raise FileFormatError(
            f"mesh screen: trimesh, which reads meshes, is not installed; run: {EXTRA}"
        ) from error
    return trimesh


def geometry_text(path: Path) -> tuple[str, bool]:
    """Vertices, texture coordinates and faces of an OBJ file, and nothing that may be private.

    Also whether it has groups; else its objects are the parts.
    """
    text = path.read_text("utf-8", errors="replace").replace("\\\n", " ")
    groups = re.search(r"^g\s+\S", text, re.MULTILINE) is not None
    lines = list[str]()
    for line in text.splitlines():
        key, *words = line.split() if line.strip() else [""]
        if key == ("g" if groups else "o"):
            lines.append(f"{key} {_part_name(' '.join(words))}")
        elif key in GEOMETRY and all(NUMBERS.fullmatch(word) for word in words):
            lines.append(" ".join([key, *words]))
    return "\n".join(lines) + "\n", groups


def shared_parts(path: Path) -> dict[str, str]:
    """Names of a file's parts, and those that they have in a bundle: numbers, but those of usual walls."""
    text, _ = geometry_text(path)
    names = dict.fromkeys(re.findall(r"^[go] (\S+)$", text, re.MULTILINE))
    fresh = (f"part-{number}" for number in count(1))
    return {name: name if name in USUAL else next(fresh) for name in names}


def shared_text(path: Path) -> str:
    """What a bundle has of a file."""
    names = shared_parts(path)
    return re.sub(
        r"^([go]) (\S+)$",
        lambda found: f"{found[1]} {names[found[2]]}",
        geometry_text(path)[0],
        flags=re.MULTILINE,
    )


def _part_name(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or "part"


def _joined(path: Path, parts: Sequence[Any]) -> Surface:
    """One surface of the parts."""
    faces, texture, start = list[IndexArray](), list[Array](), 0
    for part in parts:
        own = np.asarray(part.faces, np.intp).reshape(-1, 3)
        uv = getattr(part.visual, "uv", None)
        blank = np.full((len(part.vertices), 2), np.nan)
        texture.append((blank if uv is None else np.asarray(uv, float)[:, :2])[own])
        faces.append(own + start)
        start += len(part.vertices)
    return Surface(
        path,
        np.concatenate([np.asarray(part.vertices, float)[:, :3] for part in parts]),
        np.concatenate(faces),
        np.repeat(np.arange(len(parts)), [len(own) for own in faces]),
        np.concatenate(texture),
    )


def _check_numbers(surface: Surface) -> None:
    bad = int((~np.isfinite(surface.vertices)).any(axis=1).sum())
    if bad:
        raise surface.fault(
            f"{bad} of {len(surface.vertices)} vertices are NaN or infinite; delete them and close the holes"
        )
    if surface.extent > LARGEST_M:
        raise surface.fault(
            f"it extends over {surface.extent:.6g} m, more than {LARGEST_M:g}; if it is in millimetres, "
            "scale it by 0.001 to metres"
        )
    if len(surface.faces) > MOST_FACES:
        raise surface.fault(
            f"{len(surface.faces)} faces; {MOST_FACES} fit into memory, and 20000 are plenty. Reduce it, "
            "such as by quadric decimation"
        )


def _lit_faces(surface: Surface, names: Sequence[str], lit: Sequence[str]) -> BoolArray:
    there = [names[number] for number in np.unique(surface.part)]
    unknown = [name for name in lit if name not in there]
    if unknown:
        raise surface.fault(
            f"no group {unknown[0]!r}, which is to be lit; its groups are {', '.join(there)}"
        )
    return np.isin(surface.part, [names.index(name) for name in lit])


def _check_texture(surface: Surface, names: Sequence[str], lit: BoolArray) -> None:
    """Refuse lit faces without a place on the canvas, outside of it, or mirrored."""
    texture, part = surface.texture[lit], surface.part[lit]
    bare = ~np.isfinite(texture).all(axis=(1, 2))
    if bare.any():
        raise surface.fault(
            f"group {names[part[bare][0]]} has faces without texture coordinates (vt), which say where on "
            "the canvas they are; unwrap it"
        )
    outside = (texture < -OUTSIDE) | (texture > 1 + OUTSIDE)
    if outside.any():
        raise surface.fault(
            f"group {names[part[outside.any(axis=(1, 2))][0]]} has texture coordinates outside of 0 to 1; "
            "place all of it on one picture"
        )
    area = face_areas(surface.vertices, surface.faces[lit])
    wrong = _signed(texture) <= 0
    if area[wrong].sum() > MIRRORED * area.sum():
        raise surface.fault(
            f"{wrong.sum()} of {len(wrong)} lit faces, the first in group {names[part[wrong][0]]}, have no "
            "area on the canvas or lie there as seen from behind, so that pictures would be mirrored; turn "
            "their texture over"
        )


def _signed(texture: Array) -> Array:
    """Twice the signed areas (F,) of triangles (F, 3, 2)."""
    a, b, c = np.moveaxis(texture, 1, 0)
    one, other = (b - a).T, (c - a).T
    return np.asarray(one[0] * other[1] - one[1] * other[0])


def _room(surface: Surface, names: tuple[str, ...], lit: BoolArray, file: MeshFile) -> Room:
    """The room with faces cut, its places [m] scaled so that the canvas has the area of the lit parts."""
    texture = np.where(lit[:, None, None], surface.texture, np.nan)
    shared = np.concatenate(
        [
            surface.vertices[surface.faces],
            texture,
            np.broadcast_to(surface.part[:, None, None], (*texture.shape[:2], 1)),
        ],
        axis=-1,
    ).reshape(-1, 6)
    distinct, index = np.unique(np.nan_to_num(shared, nan=-1.0), axis=0, return_inverse=True)
    area = face_areas(surface.vertices, surface.faces)
    longest = np.sqrt(8 * area.sum() / FACES)
    cut, faces, origin = subdivided(distinct, index.reshape(-1, 3), longest, MOST_FACES // 4)
    size = _canvas_m(
        file.canvas, float(area[lit].sum()), float(_signed(surface.texture[lit]).sum())
    )
    place = np.stack([cut[:, 3], 1 - cut[:, 4]], axis=1) * size
    place[np.setdiff1d(np.arange(len(cut)), faces[lit[origin]])] = np.nan
    return Room(names, cut[:, :3], faces, surface.part[origin], place, size, file.smooth)


def _canvas_m(canvas: tuple[int, int], lit_m2: float, twice_share: float) -> tuple[float, float]:
    """Width and height [m] of the canvas, on which the lit parts have the area that they have in the room."""
    width, height = canvas
    scale = np.sqrt(lit_m2 / (width * height * twice_share / 2))
    return float(scale * width), float(scale * height)


def _check_overlap(surface: Surface, room: Room) -> None:
    covered = rasterised_share(room.place / np.array(room.size_m), room.faces)
    if covered < 1 - OVERLAP:
        raise surface.fault(
            f"{1 - covered:.0%} of the lit faces lie over others on the canvas, so that both would show one "
            "picture; move the texture islands apart"
        )


def _check_sight(surface: Surface, room: Room, file: MeshFile) -> None:
    tracer = MeshTracer(room.vertices, room.faces, smooth=room.smooth)
    hidden = ~seen_faces(room.vertices, room.faces, tracer)
    area = face_areas(room.vertices, room.faces)
    for name in file.lit:
        own = room.part == room.names.index(name)
        share = area[own & hidden].sum() / area[own].sum()
        if share > HIDDEN:
            at = ", ".join(f"{x:g}" for x in file.origin_m)
            raise surface.fault(
                f"the point ({at}) does not see {share:.0%} of group {name}; set screen.origin_m to a point "
                "of the mesh that sees all that is lit. Parts that no single point sees cannot be lit"
            )
