"""The mesh of a room from an OBJ file: its groups are parts, its texture coordinates places on the canvas."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.files.meshes import Surface, checked
from procam.files.obj import MOST_FACES, read_obj
from procam.maths.mesh.canvas import rasterised_share
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.raycast import MeshTracer, weights_of_corners
from procam.maths.mesh.rooms import Room
from procam.maths.mesh.shape import seen_faces
from procam.maths.mesh.subdivision import subdivided

LARGEST_M = 500.0
FACES = 6000  # of a mesh of few, about
HIDDEN = 0.1  # of a lit part's area: what the origin may not see of it, as behind seats
OVERLAP = 0.02  # of the area of texture islands: rounding of pixels, at most
OUTSIDE = 1e-6  # of texture coordinates
STRETCHED = 1.25  # height over width of what is square on the canvas
TOUCHING = 1e-5  # of the extent: distance of points that are one
LAYERED = 0.001  # of all faces that the origin sees
MIRRORED = 0.01  # of a part's area


@dataclass(frozen=True)
class MeshFile:
    """What venue.toml has of an OBJ file.

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
    surface, names = read_obj(file.path)
    _check_numbers(surface)
    surface = replace(surface, vertices=surface.vertices - np.array(file.origin_m))
    if np.linalg.norm(surface.vertices, axis=1).min() < TOUCHING * surface.extent:
        raise surface.fault(
            "the origin is one of its vertices; set screen.origin_m within the room"
        )
    surface = checked(surface)
    lit = _lit_faces(surface, names, file.lit)
    for name in file.lit:
        _check_texture(surface, name, surface.part == names.index(name))
    room = _room(surface, names, lit, file)
    _check_aspect(surface, room, file)
    _check_overlap(surface, room)
    _check_sight(surface, room, file)
    return room


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


def _lit_faces(surface: Surface, names: Sequence[str], lit: Sequence[str]) -> BoolArray:
    there = [names[number] for number in np.unique(surface.part)]
    unknown = [name for name in lit if name not in there]
    if unknown:
        raise surface.fault(
            f"no group {unknown[0]!r}, which is to be lit; its groups are {', '.join(there)}"
        )
    return np.isin(surface.part, [names.index(name) for name in lit])


def _check_texture(surface: Surface, name: str, own: BoolArray) -> None:
    """Refuse a lit part with faces that have no place on the canvas, are outside of it, or mirrored."""
    texture = surface.texture[own]
    if not np.isfinite(texture).all():
        raise surface.fault(
            f"group {name} has faces without texture coordinates (vt), which say where on "
            "the canvas they are; unwrap it"
        )
    if texture.min() < -OUTSIDE or texture.max() > 1 + OUTSIDE:
        raise surface.fault(
            f"group {name} has texture coordinates outside of 0 to 1; "
            "place all of it on one picture"
        )
    area, wrong = face_areas(surface.vertices, surface.faces[own]), _signed(texture) <= 0
    if area[wrong].sum() > MIRRORED * area.sum():
        raise surface.fault(
            f"{wrong.sum()} of {len(wrong)} faces of group {name} have no area on the canvas or lie there as "
            "seen from behind, so that pictures would be mirrored; turn their texture over, or set "
            "screen.origin_m within the room"
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
    cut, faces, origin = subdivided(distinct, index.reshape(-1, 3), longest, MOST_FACES)
    size = _canvas_m(
        file.canvas, float(area[lit].sum()), float(_signed(surface.texture[lit]).sum())
    )
    place = np.stack([cut[:, 3], 1 - cut[:, 4]], axis=1) * size
    place[np.setdiff1d(np.arange(len(cut)), faces[lit[origin]])] = np.nan
    vertices = _on_patches(surface, cut[:, :3], faces, origin) if file.smooth else cut[:, :3]
    return Room(names, vertices, faces, surface.part[origin], place, size, file.smooth)


def _on_patches(surface: Surface, vertices: Array, faces: IndexArray, origin: IndexArray) -> Array:
    """Vertices (V, 3) of faces (F, 3) that are parts of `origin` (F,), on the surface's smooth patches."""
    tracer = MeshTracer(surface.vertices, surface.faces, smooth=True)
    used, first = np.unique(faces, return_index=True)
    whole, moved = origin[first // 3], vertices.copy()
    share = weights_of_corners(surface.vertices[surface.faces[whole]], vertices[used])
    moved[used] = tracer.points_on(whole, share[:, 1], share[:, 2])
    return moved


def _canvas_m(canvas: tuple[int, int], lit_m2: float, twice_share: float) -> tuple[float, float]:
    """Width and height [m] of the canvas, on which the lit parts have the area that they have in the room."""
    width, height = canvas
    scale = np.sqrt(lit_m2 / (width * height * twice_share / 2))
    return float(scale * width), float(scale * height)


def _check_aspect(surface: Surface, room: Room, file: MeshFile) -> None:
    """Refuse a canvas on which most of a picture is stretched."""
    corner, place = room.vertices[room.faces], room.place[room.faces]
    lit = np.isfinite(place).all(axis=(1, 2))
    along = np.moveaxis(corner[lit, 1:] - corner[lit, :1], 1, 2)  # (F, 3, 2): edges
    per_m = (place[lit, 1:] - place[lit, :1]).swapaxes(1, 2) @ np.linalg.pinv(along)  # (F, 2, 3)
    area = face_areas(room.vertices, room.faces[lit])
    across, down = np.sqrt(np.einsum("f,fij->i", area, per_m**2))
    if not 1 / STRETCHED < down / across < STRETCHED:
        width, height = file.canvas
        raise surface.fault(
            f"pictures of canvas = {[width, height]} would be stretched by {down / across:.2f} in height; by "
            f"its texture coordinates {[width, round(height * across / down)]} fits"
        )


def _check_overlap(surface: Surface, room: Room) -> None:
    covered = rasterised_share(room.place / np.array(room.size_m), room.faces)
    if covered < 1 - OVERLAP:
        raise surface.fault(
            f"{1 - covered:.0%} of the lit faces lie over others on the canvas, so that both would show one "
            "picture; move the texture islands apart"
        )


def _check_sight(surface: Surface, room: Room, file: MeshFile) -> None:
    tracer = MeshTracer(room.vertices, room.faces, smooth=room.smooth)
    _check_layers(surface, room, tracer)
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


def _check_layers(surface: Surface, room: Room, tracer: MeshTracer) -> None:
    """Refuse faces that lie on others, such as a door on a wall that was not cut out: light meets either."""
    middle = room.vertices[room.faces].mean(axis=1)
    hits = tracer.first_hits(np.zeros(3), middle)
    near = np.linalg.norm(hits.points - middle, axis=1) < TOUCHING * surface.extent
    layered = np.flatnonzero(near & (hits.faces != np.arange(len(middle))))
    if len(layered) > LAYERED * len(middle):
        one, other = (room.names[room.part[f]] for f in (layered[0], hits.faces[layered[0]]))
        raise surface.fault(
            f"faces of group {one} lie on faces of group {other}, so that light could meet either; cut a "
            "hole into one for the other"
        )
