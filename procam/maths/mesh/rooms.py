"""Screens made of dimensions: boxes and cylinders as meshes, with the places of their lit parts on a canvas.

Frame: x to the front, y to the left, z up, the origin in the middle of a box, or of the axis of a cylinder. A
canvas is the picture that content is made for; lengths on it are those on the screen, so that the walls of a
box lie in a strip, the floor below the front wall. A part that projectors do not light is not on the canvas,
and reflects.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, IndexArray
from procam.errors import InputError

STRIP = ("left", "front", "right", "back")  # walls of a box on the canvas, from left to right
BOX = (*STRIP, "floor", "ceiling")
CYLINDER = ("wall", "floor")
LARGEST_M = 500.0
SMALLEST_ARC = np.radians(10)  # a smaller one was given in radians
NO_AREA = 1e-12  # of a part's area: triangles at the axis of a round floor
Points = Callable[
    [Array, Array], Array
]  # (...) and (...) [m] along and down a part to (..., 3) [m]


@dataclass(frozen=True, slots=True)
class Part:
    """A wall or floor: a rectangle that `points` maps to the room; from inside, (0, 0) is its upper left."""

    name: str
    width_m: float
    height_m: float
    points: Points


@dataclass(frozen=True, slots=True)
class Room:
    """A mesh of parts with its canvas.

    Attributes
    ----------
    vertices : (V, 3) [m]. faces : (F, 3), counter-clockwise seen from inside. part : (F,) number of each
        face's part, by `names`.
    place : (V, 2) position on the canvas, from its upper left corner [m]; NaN of parts that are not lit.
    size_m : width and height of the canvas.
    smooth : the mesh samples curved walls, with creases between them; else its faces are flat.
    """

    names: tuple[str, ...]
    vertices: Array
    faces: IndexArray
    part: IndexArray
    place: Array
    size_m: tuple[float, float]
    smooth: bool = False

    def layout(self) -> dict[str, tuple[float, float, float, float]]:
        """Left, top, width and height of each lit part on the canvas [m]."""
        boxes = {}
        for number, name in enumerate(self.names):
            place = self.place[np.unique(self.faces[self.part == number])]
            if np.isfinite(place).all():
                (left, top), (width, height) = place.min(axis=0), np.ptp(place, axis=0)
                boxes[name] = (float(left), float(top), float(width), float(height))
        return boxes


def planned_room(
    kind: str, size: tuple[float, float, float], lit: Sequence[str], faces: int
) -> Room:
    """A room of about so many faces.

    `kind` "box": width, depth and height [m]; "cylinder": radius [m], arc [degrees] and height [m].
    """
    if kind == "box":
        width, depth, height = size
        area_m2 = 2 * (width * depth + width * height + depth * height)
        return box_room(size, lit, float(np.sqrt(2 * area_m2 / faces)))
    radius_m, arc_deg, height_m = size
    arc = float(np.radians(arc_deg))
    area_m2 = arc * radius_m * (height_m + radius_m)  # a floor has as many columns as the wall
    return cylinder_room(radius_m, arc, height_m, lit, float(np.sqrt(2 * area_m2 / faces)))


def box_room(size_m: tuple[float, float, float], lit: Sequence[str], edge_m: float) -> Room:
    """A closed box of some width, depth and height [m]; faces have edges of `edge_m` at most.

    Raises
    ------
    InputError
        A length that is not above 0, or a part that a box does not have.
    """
    width, depth, height = _lengths("box", size_m)
    x, y, z = depth / 2, width / 2, height / 2
    right, down, front = -np.eye(3)[1], -np.eye(3)[2], np.eye(3)[0]
    parts = [
        _flat("left", (-x, y, z), front, down, (depth, height)),
        _flat("front", (x, y, z), right, down, (width, height)),
        _flat("right", (x, -y, z), -front, down, (depth, height)),
        _flat("back", (-x, -y, z), -right, down, (width, height)),
        _flat("floor", (x, y, -z), right, -front, (width, depth)),
        _flat("ceiling", (-x, y, z), right, front, (width, depth)),
    ]
    return _room(parts, _box_layout(parts, _checked(lit, BOX)), edge_m)


def cylinder_room(
    radius_m: float, arc: float, height_m: float, lit: Sequence[str], edge_m: float
) -> Room:
    """An upright cylinder wall over an arc [rad] about the front, and the floor within it; open else."""
    radius, height = _lengths("cylinder", (radius_m, height_m))
    if not SMALLEST_ARC <= arc <= 2 * np.pi:
        raise InputError(
            f"cylinder: an arc of {np.degrees(arc):g} degrees; {np.degrees(SMALLEST_ARC):g} to 360 are needed"
        )

    def wall(along: Array, down: Array) -> Array:
        azimuth = arc / 2 - along / radius
        return np.stack(
            [radius * np.cos(azimuth), radius * np.sin(azimuth), height / 2 - down], axis=-1
        )

    def floor(along: Array, down: Array) -> Array:
        azimuth, out = arc / 2 - along / radius, radius - down
        flat = out * np.cos(azimuth), out * np.sin(azimuth)
        return np.stack([*flat, np.full_like(out, -height / 2)], axis=-1)

    parts = [
        Part("wall", radius * arc, height, wall),
        Part("floor", radius * arc, radius, floor),
    ]
    if "floor" in _checked(lit, CYLINDER):
        raise InputError("cylinder: a round floor has no place on the canvas; only the wall is lit")
    return replace(_room(parts, {"wall": (0.0, 0.0)}, edge_m), smooth=True)


def _lengths(kind: str, lengths: Sequence[float]) -> Sequence[float]:
    if not all(0 < length <= LARGEST_M for length in lengths):
        shown = " x ".join(f"{length:g}" for length in lengths)
        raise InputError(
            f"{kind}: {shown} m; all lengths must be above 0 and at most {LARGEST_M:g}. Are they millimetres?"
        )
    return lengths


def _checked(lit: Sequence[str], names: Sequence[str]) -> Sequence[str]:
    unknown = [name for name in lit if name not in names]
    if unknown or not lit:
        found = f"{unknown[0]!r} is lit" if unknown else "nothing is lit"
        raise InputError(f"{found}; name some of {', '.join(names)}")
    return lit


def _flat(
    name: str,
    corner: Sequence[float],
    across: Array,
    down: Array,
    size_m: tuple[float, float],
) -> Part:
    start = np.array(corner)
    return Part(name, *size_m, lambda u, v: start + u[..., None] * across + v[..., None] * down)


def _box_layout(parts: Sequence[Part], lit: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Upper left corners of lit parts on the canvas [m]."""
    by_name = {part.name: part for part in parts}
    top = by_name["ceiling"].height_m if "ceiling" in lit else 0.0
    corners, at = dict[str, tuple[float, float]](), 0.0
    for name in STRIP:
        if name in lit:
            corners[name] = (at, top)
            at += by_name[name].width_m
    left = corners.get("front", (0.0, 0.0))[0]
    below = top + by_name["front"].height_m * bool(corners)
    beside = {"ceiling": (left, 0.0), "floor": (left, below)}
    return corners | {name: corner for name, corner in beside.items() if name in lit}


def _room(parts: Sequence[Part], corners: dict[str, tuple[float, float]], edge_m: float) -> Room:
    vertices, faces, number, place = [], [], [], []
    start = 0
    for index, part in enumerate(parts):
        points, where, triangles = _lattice(part, edge_m)
        vertices.append(points)
        faces.append(triangles + start)
        number.append(np.full(len(triangles), index))
        corner = corners.get(part.name, (np.nan, np.nan))
        place.append(where + np.array(corner))
        start += len(points)
    places = np.concatenate(place)
    width, height = np.nanmax(places, axis=0)
    names = tuple(part.name for part in parts)
    return Room(
        names,
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(number),
        places,
        (float(width), float(height)),
    )


def _lattice(part: Part, edge_m: float) -> tuple[Array, Array, IndexArray]:
    """Points (V, 3), their places on the part (V, 2) and triangles (F, 3)."""
    columns, rows = (max(1, round(n / edge_m)) for n in (part.width_m, part.height_m))
    u, v = np.meshgrid(
        np.linspace(0, part.width_m, columns + 1), np.linspace(0, part.height_m, rows + 1)
    )
    points = part.points(u, v).reshape(-1, 3)
    index = np.arange(points.shape[0]).reshape(rows + 1, columns + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    one, two, three = np.moveaxis(points[triangles], 1, 0)
    area = np.linalg.norm(np.cross(two - one, three - one), axis=1)
    return (
        points,
        np.stack([u, v], axis=-1).reshape(-1, 2),
        triangles[area > NO_AREA * area.sum()],
    )
