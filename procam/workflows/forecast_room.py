"""Contrast and white to expect of a room that is not built yet: a box, or an upright cylinder.

Its pictures are compensated on a mesh of the room (`compensate.room`), by dimensions and albedos alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import FloatArray, Image
from procam.compensate.room import BRIGHTEST, RoomCompensator
from procam.errors import InputError
from procam.maths.mesh.canvas import mesh_canvas
from procam.maths.mesh.compressed import compressed_factors
from procam.maths.mesh.rooms import planned_room
from procam.workflows.forecast import Levels, ratio
from procam.workflows.judged_picture import Judged, PictureFigures, Seen, figures_of

SAMPLES = 512  # longer side of the pictures that are judged [px]
FACES = 2500  # about so many: a box of 6 x 4 x 3 m in triangles of 0.3 m
MOST_ASPECT = 50  # of a canvas
SQUARES = 8  # of a checkerboard along the shorter side of the canvas
GREEN = 1


@dataclass(frozen=True, slots=True)
class PlannedRoom:
    """A room that is not built yet.

    Attributes
    ----------
    kind : "box" or "cylinder". size : of a box width, depth and height [m]; of a cylinder radius [m],
        arc [degrees] and height [m]. lit : names of the parts that projectors light.
    albedo, albedo_sigma : of these. others : albedo of the rest. contrast : of the projectors.
    """

    kind: str
    size: tuple[float, float, float]
    lit: tuple[str, ...]
    albedo: float
    albedo_sigma: float
    others: float
    contrast: float

    def __post_init__(self) -> None:
        if not 0 <= self.albedo_sigma:
            raise InputError(f"--albedo-sigma is {self.albedo_sigma:g}; 0 or more is needed")
        if not (0 < self.albedos[0] and self.albedos[-1] <= BRIGHTEST):
            raise InputError(
                f"albedo: {self.albedo:g} +- 1.96 times a sigma of {self.albedo_sigma:g} must stay between 0 "
                f"and {BRIGHTEST:g}; give a smaller --albedo-sigma, or another --albedo"
            )
        if not 0 <= self.others <= BRIGHTEST:
            raise InputError(
                f"--other-albedo is {self.others:g}; between 0 and {BRIGHTEST:g} is needed"
            )
        if not 1 < self.contrast:
            raise InputError(
                f"contrast: {self.contrast:g} must be above 1, such as 2000 for 2000:1"
            )

    @property
    def albedos(self) -> tuple[float, float, float]:
        """At the low end, in the middle and at the high end of its 95 % interval."""
        step = 1.96 * self.albedo_sigma
        return self.albedo - step, self.albedo, self.albedo + step


@dataclass(frozen=True, slots=True)
class RoomProspect:
    """A room at the low end, the middle and the high end of what is known of its paint.

    `ends` are its compensators, `size_m` that of the canvas, `layout` left, top, width and height of each lit
    part on it [m].
    """

    ends: tuple[RoomCompensator, RoomCompensator, RoomCompensator]
    contrast: float
    size_m: tuple[float, float]
    layout: dict[str, tuple[float, float, float, float]]

    @property
    def lit_m2(self) -> float:
        """Area that projectors light."""
        return float(self.ends[1].canvas.area.sum())

    def levels(self, reference: Sequence[float]) -> list[Levels]:
        """White, black and contrast at each end; `reference` is the light of a direct white of 1.0."""
        return [_levels(end, white) for end, white in zip(self.ends, reference, strict=True)]

    def picture(self, content: Image) -> tuple[list[PictureFigures], Seen]:
        """Figures of a picture on the canvas at each end, and how it is seen in the middle."""
        found = [_figures(end, content, 1 / self.contrast) for end in self.ends]
        return [figures for figures, _ in found], found[1][1]


def room_prospect(plan: PlannedRoom, samples: int = SAMPLES) -> RoomProspect:
    """The prospect of a room, with the 95 % interval of its albedo."""
    room = planned_room(plan.kind, plan.size, plan.lit, FACES)
    longest, shortest = max(room.size_m), min(room.size_m)
    if longest > MOST_ASPECT * shortest:
        raise InputError(
            f"the canvas of this room would be {room.size_m[0]:.3g} x {room.size_m[1]:.3g} m; one side may "
            f"be {MOST_ASPECT} times the other at most. Check the lengths and what is lit"
        )
    width, height = (max(1, round(samples * side / longest)) for side in room.size_m)
    canvas = mesh_canvas(
        room.vertices, room.faces, room.part, room.place / np.array(room.size_m), (width, height)
    )
    factors = compressed_factors(room.vertices, room.faces)
    lit = np.isin(room.part, [room.names.index(name) for name in plan.lit])
    black = 1 / plan.contrast

    def end(albedo: float) -> RoomCompensator:
        albedos = np.where(lit, albedo, plan.others)[:, None] * np.ones((1, 3))
        return RoomCompensator(canvas, factors, albedos, black)

    low, middle, high = (end(albedo) for albedo in plan.albedos)
    return RoomProspect((low, middle, high), plan.contrast, room.size_m, room.layout())


def _levels(room: RoomCompensator, reference: float) -> Levels:
    canvas = room.canvas
    white = np.ones((*canvas.face.shape, 3), np.float32)
    checker = white * _checkerboard(canvas.face.shape)
    ideal = room.with_black(0.0)
    before, black = (_mean(room, room.none(picture).observed) for picture in (white, 0 * white))
    after = _mean(room, room.exact(white).observed)
    m = _mean(ideal, ideal.none(white).observed) - 1
    none, exact = room.none(checker).observed, room.exact(checker).observed
    return Levels(
        m,
        m / (1 + m),
        reference * before,
        reference * after,
        reference * black,
        ratio(before, black),
        ratio(after, black),
        _contrast(room, ideal.none(checker).observed, checker),
        _contrast(room, none, checker),
        _contrast(room, exact, checker),
    )


def _figures(room: RoomCompensator, content: Image, black: float) -> tuple[PictureFigures, Seen]:
    content, lit = content.astype(np.float32), room.canvas.lit
    judged = Judged(lit, lit, room.canvas.area.astype(float), black)
    return figures_of(content, room.none(content).observed, room.exact(content), judged)


def _checkerboard(shape: tuple[int, ...]) -> Image:
    side = max(1, min(shape) // SQUARES)
    row, column = np.indices(shape) // side
    return ((row + column) % 2)[..., None].astype(np.float32)


def _mean(room: RoomCompensator, light: Image, where: FloatArray | float = 1.0) -> float:
    weight = room.canvas.area * where
    return float((light[..., GREEN] * weight).sum(dtype=float) / weight.sum(dtype=float))


def _contrast(room: RoomCompensator, light: Image, checker: Image) -> float:
    white = checker[..., GREEN]
    return ratio(_mean(room, light, white), _mean(room, light, 1 - white))
