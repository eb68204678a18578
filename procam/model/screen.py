"""The projection screen: a dome, or a room by its dimensions or as a mesh.

Both have the same interface: `shape`, which rays meet; `canvas`, of content and of a calibration's maps;
`contains`; and `measure`, on which areas are counted. A place is a direction from the origin, which must see
all parts of a room that projectors light.
"""

import hashlib
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Union

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray
from procam.errors import UnitError
from procam.maths.geometry.canvas import STANDARD, Canvas
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.geometry.sphere import angles_from_direction, normalise

if TYPE_CHECKING:
    from procam.maths.mesh.compressed import CompressedFactors
    from procam.maths.mesh.room_canvas import RoomCanvas
    from procam.maths.mesh.rooms import Room
    from procam.maths.mesh.shape import MeshShape

FACES = 4000  # of a room, about
NAMED = 1024  # width of the canvas on which places are named
GEOMETRY = ("room", "shape", "canvas", "factors")  # what is kept of a room


@dataclass(frozen=True, slots=True)
class Dome:
    """A spherical cap about the dome frame's origin, its pole on z.

    Attributes
    ----------
    radius_m : sphere radius [m].
    half_angle : angle from the pole to the rim of the whole screen, lit or not [rad].
    tilt : angle between the pole and the vertical, positive towards the front [rad].
    floor_albedo, floor_albedo_sigma : diffuse reflectance of the floor under the dome [-]; in a
        calibration, of one in the plane of the rim's lowest point that returns as much light. It enters
        the albedo only, never the compensation.
    bumps : harmonic coefficients of the radius from degree 2 to `degree`, relative to the radius;
        none for a sphere.
    """

    radius_m: float
    half_angle: float
    tilt: float = 0.0
    floor_albedo: float = 0.0
    floor_albedo_sigma: float = 0.0
    bumps: tuple[float, ...] = ()
    degree: int = 0

    def __post_init__(self) -> None:
        if not self.radius_m > 0:  # also refuses NaN
            raise UnitError(f"radius_m is {self.radius_m}; it needs a length above 0 metres")
        if not 0 < self.half_angle < 3.1416:
            raise UnitError(
                f"half_angle is {self.half_angle} rad; it needs an angle between 0 and pi"
            )

    @property
    def kind(self) -> str:
        """Its word in files."""
        return "dome"

    @property
    def shape(self) -> RoundShape:
        """The surface that rays meet."""
        return RoundShape(self.radius_m, np.array(self.bumps), self.degree)

    @property
    def canvas(self) -> Canvas:
        """The dome master of a calibration's maps."""
        return STANDARD

    def contains(self, direction: FloatArray) -> BoolArray:
        """Whether directions (..., 3) lie on the cap."""
        return np.asarray(direction[..., 2] >= np.cos(self.half_angle))

    def named(self, direction: Array) -> str:
        """A direction (3,) in words."""
        azimuth, elevation = np.degrees(angles_from_direction(direction))
        return f"azimuth {azimuth:.0f}, elevation {elevation:.0f} degrees"

    def measure(self, points: Array) -> Array:
        """Points (..., 3) as areas are counted, in solid angles from the centre [sr]: on the unit sphere."""
        return normalise(points)

    def solved(self, shape: RoundShape) -> "Dome":
        """The dome with a shape that was solved."""
        bumps = tuple(float(b) for b in shape.harmonic_coefficients)
        return replace(self, radius_m=shape.radius_m, bumps=bumps, degree=shape.degree)


@dataclass(frozen=True)
class RoomScreen:
    """A room by its dimensions, or a mesh, of which projectors light some parts.

    Attributes
    ----------
    kind : "box", "cylinder" or "mesh". size : of a box width, depth and height [m]; of a cylinder radius
        [m], arc [degrees] and height [m]; of a mesh its extent along x, y and z [m].
    lit : names of the parts that projectors light.
    others : parts that are not lit: name, albedo and its standard error [-].
    moved : lit parts that are not where the drawing has them, and how, see `maths.mesh.wall_moves`.
    mesh : that of a "mesh" as it was drawn; it counts by its `digest` when screens are compared.
    """

    kind: str
    size: tuple[float, float, float]
    lit: tuple[str, ...]
    others: tuple[tuple[str, float, float], ...] = ()
    moved: tuple[tuple[str, tuple[float, ...]], ...] = ()
    mesh: "Room | None" = field(default=None, compare=False, repr=False)
    digest: str = ""

    @classmethod
    def of_mesh(
        cls, mesh: "Room", lit: tuple[str, ...], others: tuple[tuple[str, float, float], ...]
    ) -> "RoomScreen":
        """The screen of a mesh."""
        found = hashlib.sha256(repr((mesh.names, mesh.size_m, mesh.smooth)).encode())
        for array in (mesh.vertices, mesh.faces, mesh.part, mesh.place):
            found.update(np.ascontiguousarray(array).tobytes())
        x, y, z = map(float, np.ptp(mesh.vertices, axis=0))
        return cls("mesh", (x, y, z), lit, others, mesh=mesh, digest=found.hexdigest())

    @cached_property
    def room(self) -> "Room":
        """Its mesh and canvas."""
        from procam.maths.mesh.rooms import planned_room  # noqa: PLC0415 - SciPy
        from procam.maths.mesh.wall_moves import moved_by  # noqa: PLC0415 - SciPy

        drawn = self.mesh or planned_room(self.kind, self.size, self.lit, FACES)
        moves = {drawn.names.index(name): np.array(numbers) for name, numbers in self.moved}
        by = moved_by(drawn.vertices, drawn.faces, drawn.part, moves)
        return replace(drawn, vertices=drawn.vertices + by)

    @cached_property
    def shape(self) -> "MeshShape":
        """The surface that rays meet."""
        from procam.maths.mesh.shape import MeshShape  # noqa: PLC0415 - SciPy, which domes do not need

        room, convex = self.room, self.mesh is None
        free = {number: n for number, n in enumerate(room.names) if n in self.lit}
        return MeshShape.of(
            room.vertices,
            room.faces,
            smooth=room.smooth,
            part=room.part,
            free=free,
            convex=convex,
        )

    @cached_property
    def canvas(self) -> "RoomCanvas":
        """The canvas of content and of a calibration's maps."""
        from procam.maths.mesh.room_canvas import RoomCanvas  # noqa: PLC0415 - SciPy

        return RoomCanvas(self.room, self.shape)

    @cached_property
    def factors(self) -> "CompressedFactors":
        """Form factors between its faces; computing them takes some seconds."""
        from procam.maths.mesh.compressed import compressed_factors  # noqa: PLC0415 - SciPy

        return compressed_factors(self.room.vertices, self.room.faces)

    def with_factors(self, factors: "CompressedFactors") -> "RoomScreen":
        """The room with form factors that were computed before."""
        found = self.with_others(self.others)
        vars(found)["factors"] = factors
        return found

    def with_others(self, others: tuple[tuple[str, float, float], ...]) -> "RoomScreen":
        """The room with other albedos of what is not lit; what was computed of its shape is kept."""
        found = replace(self, others=others)
        vars(found).update({name: vars(self)[name] for name in GEOMETRY if name in vars(self)})
        return found

    @property
    def has_factors(self) -> bool:
        """Whether its form factors have been computed."""
        return "factors" in vars(self)

    @cached_property
    def stated_albedo(self) -> Array:
        """Albedo and its standard error (F, 2) of faces that are not lit; 0 of the others."""
        of = {name: (value, sigma) for name, value, sigma in self.others}
        return np.array([of.get(name, (0.0, 0.0)) for name in self.room.names])[self.room.part]

    def face_albedo(self, lit: Array) -> Array:
        """Albedo (F, 3) of the faces, where (F, 3) is given for lit ones."""
        others = np.repeat(self.stated_albedo[:, :1], 3, axis=1)
        others[self.canvas.lit_faces] = lit[self.canvas.lit_faces]
        return others

    def contains(self, direction: FloatArray) -> BoolArray:
        """Whether directions (..., 3) are known: the room is all around."""
        return np.asarray(np.isfinite(direction).all(axis=-1))

    def named(self, direction: Array) -> str:
        """The place on the canvas in a direction (3,), in words."""
        width_m, height_m = self.room.size_m
        rows, columns = self.canvas.shape(NAMED)
        x, y = self.canvas.pixels(normalise(direction), NAMED) + 0.5
        across, down = x * width_m / columns, y * height_m / rows
        return f"{across:.1f} m from the left and {down:.1f} m from the top of the canvas"

    def measure(self, points: Array) -> Array:
        """Points (..., 3) as areas are counted, in [m^2]: as they are."""
        return points

    def solved(self, shape: RoundShape) -> "RoomScreen":
        """The room as it was drawn, with its walls where a shape that was solved has them."""
        from procam.maths.mesh.shape import MeshShape  # noqa: PLC0415 - SciPy

        if not isinstance(shape, MeshShape) or not shape.moves.any():
            return self
        moved = shape.moved_parts().items()
        return replace(self, moved=tuple((name, tuple(map(float, by))) for name, by in moved))


Screen = Dome | RoomScreen
ContentCanvas = Union[Canvas, "RoomCanvas"]
