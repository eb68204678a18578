"""Walls of simulated rooms: flat rectangles, a cylinder's arc, the round floor within it.

Positions (u, v) on a wall run from 0 to 1; seen from inside, (0, 0) is its upper left corner. Frame: x to the
front, y to the left, z up.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from procam.arrays import Array, BoolArray

STRIP = ("left", "front", "right", "back")
NEAREST_M = 1e-5  # of a hit: a ray that starts on a wall does not meet it


class Wall(Protocol):
    """A part of a room that light falls on."""

    @property
    def name(self) -> str:
        """Such as "front"."""

    @property
    def size_m(self) -> tuple[float, float]:
        """Along u and along v."""

    def points(self, u: Array, v: Array) -> Array:
        """Points (..., 3) [m] at positions (...)."""

    def inwards(self, points: Array) -> Array:
        """Unit normals (..., 3), towards the room, at points (..., 3) of the wall."""

    def hit(self, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
        """Distance (N,) at which rays (N, 3) meet its inside, infinite if they do not, and u, v there."""

    def cell_areas(self, columns: int, rows: int) -> Array:
        """Areas (rows, columns) [m^2] of cells of equal steps in u and v."""

    def place(self, points: Array) -> tuple[Array, Array]:
        """u, v (...) of points (..., 3) on the wall."""


@dataclass(frozen=True)
class FlatWall:
    """A rectangle with its upper left `corner` (3,) and its edges `across` and `down` (3,) [m]."""

    name: str
    corner: Array
    across: Array
    down: Array

    @property
    def size_m(self) -> tuple[float, float]:
        """Along u and along v."""
        return float(np.linalg.norm(self.across)), float(np.linalg.norm(self.down))

    @property
    def _normal(self) -> Array:
        normal = np.cross(self.down, self.across)
        return np.asarray(normal / np.linalg.norm(normal))

    def points(self, u: Array, v: Array) -> Array:
        """Points (..., 3) [m]."""
        return np.asarray(self.corner + u[..., None] * self.across + v[..., None] * self.down)

    def inwards(self, points: Array) -> Array:
        """Unit normals (..., 3)."""
        return np.broadcast_to(self._normal, points.shape)

    def hit(self, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
        """See `Wall.hit`."""
        speed = direction @ self._normal
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (self.corner - origin) @ self._normal / speed
        met = (speed < 0) & (reach > NEAREST_M)
        reach = np.where(met, reach, np.inf)
        u, v = self.place(origin + np.where(met, reach, 0.0)[:, None] * direction)
        return np.where(_within(u) & _within(v), reach, np.inf), u, v

    def cell_areas(self, columns: int, rows: int) -> Array:
        """See `Wall.cell_areas`."""
        return np.full((rows, columns), np.prod(self.size_m) / (columns * rows))

    def place(self, points: Array) -> tuple[Array, Array]:
        """u, v (...) of points (..., 3)."""
        offset = points - self.corner
        u, v = (offset @ edge / (edge @ edge) for edge in (self.across, self.down))
        return u, v


@dataclass(frozen=True)
class ArcWall:
    """An upright cylinder about the z axis, over an arc [rad] about the front, `top_m` to `bottom_m`."""

    name: str
    radius_m: float
    arc: float
    top_m: float
    bottom_m: float

    @property
    def size_m(self) -> tuple[float, float]:
        """Along u and along v."""
        return self.radius_m * self.arc, self.top_m - self.bottom_m

    def points(self, u: Array, v: Array) -> Array:
        """Points (..., 3) [m]."""
        azimuth, height = self.arc * (0.5 - u), self.top_m - v * self.size_m[1]
        flat = self.radius_m * np.cos(azimuth), self.radius_m * np.sin(azimuth)
        return np.stack([*flat, np.broadcast_to(height, azimuth.shape)], axis=-1)

    def inwards(self, points: Array) -> Array:
        """Unit normals (..., 3)."""
        level = points * [1.0, 1.0, 0.0]
        return np.asarray(-level / np.linalg.norm(level, axis=-1, keepdims=True))

    def hit(self, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
        """See `Wall.hit`: the farther root, where a ray from inside leaves the cylinder."""
        level = direction[:, :2]
        speed = np.maximum(np.sum(level**2, axis=1), 1e-30)
        along = np.sum(origin[:, :2] * level, axis=1) / speed
        square = along**2 - (np.sum(origin[:, :2] ** 2, axis=1) - self.radius_m**2) / speed
        reach = np.sqrt(np.maximum(square, 0)) - along
        met = (square > 0) & (reach > NEAREST_M) & np.isfinite(reach)
        u, v = self.place(origin + np.where(met, reach, 0.0)[:, None] * direction)
        return np.where(met & _within(u) & _within(v), reach, np.inf), u, v

    def cell_areas(self, columns: int, rows: int) -> Array:
        """See `Wall.cell_areas`."""
        return np.full((rows, columns), np.prod(self.size_m) / (columns * rows))

    def place(self, points: Array) -> tuple[Array, Array]:
        """u, v (...) of points (..., 3)."""
        u = 0.5 - np.arctan2(points[..., 1], points[..., 0]) / self.arc
        return u, (self.top_m - points[..., 2]) / self.size_m[1]


@dataclass(frozen=True)
class ArcFloor:
    """The level sector below an arc [rad]; u along the arc, v from the wall to the axis."""

    name: str
    radius_m: float
    arc: float
    height_m: float

    @property
    def size_m(self) -> tuple[float, float]:
        """Along u, at the wall, and along v."""
        return self.radius_m * self.arc, self.radius_m

    def points(self, u: Array, v: Array) -> Array:
        """Points (..., 3) [m]."""
        azimuth, out = self.arc * (0.5 - u), self.radius_m * (1 - v)
        level = np.full(np.broadcast(azimuth, out).shape, self.height_m)
        return np.stack([out * np.cos(azimuth), out * np.sin(azimuth), level], axis=-1)

    def inwards(self, points: Array) -> Array:
        """Unit normals (..., 3)."""
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), points.shape)

    def hit(self, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
        """See `Wall.hit`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = (self.height_m - origin[:, 2]) / direction[:, 2]
        met = (direction[:, 2] < 0) & (reach > NEAREST_M)
        reach = np.where(met, reach, np.inf)
        u, v = self.place(origin + np.where(met, reach, 0.0)[:, None] * direction)
        return np.where(_within(u) & _within(v), reach, np.inf), u, v

    def cell_areas(self, columns: int, rows: int) -> Array:
        """See `Wall.cell_areas`: rings grow with their radius."""
        out = self.radius_m * np.linspace(1, 0, rows + 1)
        ring = self.arc / 2 * (out[:-1] ** 2 - out[1:] ** 2)
        return np.repeat(ring[:, None] / columns, columns, axis=1)

    def place(self, points: Array) -> tuple[Array, Array]:
        """u, v (...) of points (..., 3)."""
        u = 0.5 - np.arctan2(points[..., 1], points[..., 0]) / self.arc
        return u, 1 - np.hypot(points[..., 0], points[..., 1]) / self.radius_m


def box_walls(size_m: tuple[float, float, float]) -> list[Wall]:
    """The walls of a box of some width, depth and height about the origin."""
    width, depth, height = size_m
    x, y, z = depth / 2, width / 2, height / 2
    right, down, front = -np.eye(3)[1], -np.eye(3)[2], np.eye(3)[0]

    def wall(name: str, corner: tuple[float, ...], across: Array, along: Array) -> FlatWall:
        return FlatWall(name, np.array(corner), across, along)

    return [
        wall("left", (-x, y, z), depth * front, height * down),
        wall("front", (x, y, z), width * right, height * down),
        wall("right", (x, -y, z), -depth * front, height * down),
        wall("back", (-x, -y, z), -width * right, height * down),
        wall("floor", (x, y, -z), width * right, -depth * front),
        wall("ceiling", (-x, y, z), width * right, depth * front),
    ]


def cylinder_walls(radius_m: float, arc: float, height_m: float) -> list[Wall]:
    """The wall of a cylinder over an arc [rad], and the floor within it; about the middle of its axis."""
    top = height_m / 2
    return [ArcWall("wall", radius_m, arc, top, -top), ArcFloor("floor", radius_m, arc, -top)]


def l_walls(size_m: tuple[float, float, float], cut_m: tuple[float, float]) -> list[Wall]:
    """The walls of an L: a box without the corner `cut_m` (width, depth) at its front on the right.

    Its front is that of the long leg; "inner-front" and "inner-right" are the walls of the missing corner.
    Floor and ceiling have two rectangles each, "floor" and "inner-floor".
    """
    width, depth, height = size_m
    cut_width, cut_depth = cut_m
    x, y, z = depth / 2, width / 2, height / 2
    right, down, front = -np.eye(3)[1], -np.eye(3)[2], np.eye(3)[0]
    walls = {wall.name: wall for wall in box_walls(size_m)}

    def wall(name: str, corner: tuple[float, ...], across: Array, along: Array) -> FlatWall:
        return FlatWall(name, np.array(corner), across, along)

    leg, short = width - cut_width, depth - cut_depth
    return [
        walls["left"],
        wall("front", (x, y, z), leg * right, height * down),
        wall("inner-right", (x, y - leg, z), -cut_depth * front, height * down),
        wall("inner-front", (x - cut_depth, y - leg, z), cut_width * right, height * down),
        wall("right", (x - cut_depth, -y, z), -short * front, height * down),
        walls["back"],
        wall("floor", (x, y, -z), leg * right, -depth * front),
        wall("inner-floor", (x - cut_depth, y - leg, -z), cut_width * right, -short * front),
        wall("ceiling", (-x, y, z), leg * right, depth * front),
        wall("inner-ceiling", (-x, y - leg, z), cut_width * right, short * front),
    ]


def canvas_corners(walls: Sequence[Wall], lit: Collection[str]) -> dict[str, tuple[float, float]]:
    """Upper left corners [m] of lit walls on the canvas: a strip, the floor below, the ceiling above."""
    size = {wall.name: wall.size_m for wall in walls if wall.name in lit}
    top = size["ceiling"][1] if "ceiling" in size else 0.0
    corners, at = dict[str, tuple[float, float]](), 0.0
    for name in ("wall", "left", "front", "right", "back"):
        if name in size:
            corners[name], at = (at, top), at + size[name][0]
    left = corners.get("front", (0.0, 0.0))[0]
    below = top + max((w.size_m[1] for w in walls if w.name in STRIP), default=0.0)
    beside = {"ceiling": (left, 0.0), "floor": (left, below)}
    return corners | {name: beside[name] for name in size if name in beside}


def walls_of(kind: str, lengths: Mapping[str, float]) -> list[Wall]:
    """The walls of a "box", a "cylinder" or an "L" by its lengths [m], and arc [degrees]."""
    if kind == "cylinder":
        arc = float(np.radians(lengths["arc_deg"]))
        return cylinder_walls(lengths["radius_m"], arc, lengths["height_m"])
    size = (lengths["width_m"], lengths["depth_m"], lengths["height_m"])
    if kind == "box":
        return box_walls(size)
    return l_walls(size, (lengths["cut_width_m"], lengths["cut_depth_m"]))


def _within(position: Array) -> BoolArray:
    edge = 1e-9  # a ray into an edge must meet one of its walls
    return (position >= -edge) & (position <= 1 + edge)
