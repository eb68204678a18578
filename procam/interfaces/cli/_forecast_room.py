"""What `procam forecast` finds for a room that is planned."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from procam.arrays import Image
from procam.errors import InputError
from procam.files.images.stills import read_picture
from procam.interfaces.cli._forecast_text import USUAL, Described, Found, check_lumens
from procam.interfaces.plots.forecast import RELATIVE
from procam.maths.mesh.rooms import CYLINDER
from procam.workflows.forecast import sampled
from procam.workflows.forecast_room import SAMPLES, PlannedRoom, RoomProspect, room_prospect

Size = tuple[float, float, float]
LIT = ("front", "left", "right")  # of a box, if none is named
OTHERS = 0.2  # albedo
OF_ROOMS = {"albedo", "albedo_sigma", "contrast"}  # options of a dome that a room has too
ASPECT = 0.01  # relative difference of a picture's sides from the canvas's


def room_found(
    paths: Sequence[Path],
    shapes: Mapping[str, Size],
    described: Described,
    lit: Sequence[str],
    others: float | None,
    lumens: float | None,
) -> Found:
    """The forecast of a box or a cylinder.

    Raises
    ------
    InputError
        Both or neither are given, options of domes, a picture of another aspect than the canvas.
    """
    check_lumens(lumens)
    plan = _planned(shapes, described, lit, OTHERS if others is None else others)
    prospect = room_prospect(plan, SAMPLES)
    read = {str(path): read_picture(path) for path in paths}
    contents = {path: _on_canvas(path, content, prospect) for path, (content, _) in read.items()}
    white = [_white(albedo, lumens, prospect.lit_m2) for albedo in plan.albedos]
    return Found(
        prospect.levels(white),
        RELATIVE if lumens is None else "cd/m2",
        {path: prospect.picture(content) for path, content in contents.items()},
        [*_assumptions(plan, prospect, lumens), *(note for _, note in read.values() if note)],
        layout=prospect.layout,
    )


def _planned(
    shapes: Mapping[str, Size], described: Described, lit: Sequence[str], others: float
) -> PlannedRoom:
    if len(shapes) > 1:
        raise InputError("forecast: --box and --cylinder are two rooms; give one of them")
    if not shapes:
        raise InputError("forecast: --lit and --other-albedo are of a room; give --box too")
    if lit and "cylinder" in shapes:
        raise InputError("forecast: --lit is for boxes; of a cylinder the wall is lit")
    foreign = [f"--{name.replace('_', '-')}" for name in described if name not in OF_ROOMS]
    if foreign:
        raise InputError(f"forecast: {', '.join(foreign)}: only for domes; leave it out for a room")
    if "albedo" not in described:
        raise InputError("forecast of a room needs --albedo, that of the parts that are lit")
    ((kind, size),) = shapes.items()
    values = USUAL | described
    usual = LIT if kind == "box" else CYLINDER[:1]
    lit = tuple(dict.fromkeys(lit)) or usual
    paint = values["albedo"], values["albedo_sigma"]
    return PlannedRoom(kind, size, lit, *paint, others, values["contrast"])


def _white(albedo: float, lumens: float | None, lit_m2: float) -> float:
    """Light of a direct white of 1.0 [cd/m2 if lumens are given]."""
    if lumens is None:
        return 1.0
    return albedo * lumens / (math.pi * lit_m2)


def _on_canvas(path: str, content: Image, prospect: RoomProspect) -> Image:
    """A picture at the size that is judged."""
    (width, height), (rows, columns) = prospect.size_m, content.shape[:2]
    off = abs(rows - columns * height / width)  # a picture has whole pixels
    if off > max(0.5, ASPECT * rows):
        raise InputError(
            f"{path} is {columns} x {rows} px, and the canvas of this room {width:g} x {height:g} m; make "
            f"it {columns} x {round(columns * height / width)} (--out draws where each wall lies on it)"
        )
    height_px, width_px = prospect.ends[1].canvas.lit.shape
    return sampled(content, width_px, height_px)


def _assumptions(plan: PlannedRoom, prospect: RoomProspect, lumens: float | None) -> Iterator[str]:
    yield (
        "matte walls; 1.0 of a picture (255 of 8 bits) is the white that every lit place reaches without "
        "inter-reflection; nobody and no furniture in the room"
    )
    yield (
        f"albedo {plan.albedo:g} with sigma {plan.albedo_sigma:g} of {', '.join(plan.lit)}, "
        f"{plan.others:g} of the rest; bands: both ends of the 95 % interval"
    )
    if plan.kind == "cylinder":
        yield "the floor reflects within the arc; above, and beyond the arc, all is black"
    width, height = prospect.size_m
    yield f"canvas {width:.4g} x {height:.4g} m; projectors of {plan.contrast:g}:1 full white to full black"
    if lumens is not None:
        yield (
            f"{lumens:g} lm, all on the {prospect.lit_m2:.4g} m2 that are lit; blending and light that "
            "misses the walls reduce this"
        )
