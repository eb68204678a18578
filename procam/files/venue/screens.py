"""The screen that [screen] of venue.toml describes, and places on it."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np

from procam.arrays import Array
from procam.files.venue.tables import (
    BoxTable,
    CylinderTable,
    DomeTable,
    MeshTable,
    PlaceTable,
    RoomTable,
    ScreenTable,
)
from procam.maths.geometry.sphere import angles_from_direction
from procam.model.screen import Dome, RoomScreen, Screen

USUAL_RADIUS_M = 5.0  # initial value where none was measured
OFF_M = 0.1  # of a mark from the mesh: more is another place
PARTS = {
    "box": ("left", "front", "right", "back", "floor", "ceiling"),
    "cylinder": ("wall", "floor"),
}
Others = tuple[tuple[str, float, float], ...]
Angles = tuple[float | None, float | None, float]  # azimuth, elevation, sigma [rad]
one_room = cache(RoomScreen)  # its mesh takes a while


def screen_of(table: ScreenTable, folder: Path) -> Screen:
    """The screen of a table in `folder`; a dome has `USUAL_RADIUS_M` where its radius is not known."""
    if isinstance(table, DomeTable):
        return Dome(
            table.radius_m or USUAL_RADIUS_M,
            float(np.radians(table.half_angle_deg)),
            float(np.radians(table.tilt_deg)),
            table.floor_albedo,
            table.floor_albedo_sigma,
        )
    if isinstance(table, MeshTable):
        return _mesh(table, folder)
    return _room(table)


def _room(table: BoxTable | CylinderTable) -> RoomScreen:
    if isinstance(table, BoxTable):
        size, lit = (table.width_m, table.depth_m, table.height_m), tuple(map(str, table.lit))
    else:
        size, lit = (table.radius_m, table.arc_deg, table.height_m), ("wall",)
    return one_room(table.kind, size, lit, _others(table, PARTS[table.kind], lit))


def _mesh(table: MeshTable, folder: Path) -> RoomScreen:
    from procam.files.venue.mesh_screen import MeshFile, read_room  # noqa: PLC0415 - SciPy

    lit = tuple(table.lit)
    room = read_room(MeshFile(folder / table.file, lit, table.canvas, table.origin_m, table.smooth))
    return RoomScreen.of_mesh(room, lit, _others(table, room.names, lit))


def _others(table: RoomTable, names: Sequence[str], lit: Sequence[str]) -> Others:
    """Albedos of the parts that are not lit."""
    usual = table.other_albedo, table.other_albedo_sigma
    return tuple((name, *table.others.get(name, usual)) for name in names if name not in lit)


def angles_of(mark: PlaceTable, screen: Screen, table: ScreenTable) -> Angles:
    """Azimuth and elevation of a mark, None where not known, and their standard error [rad]."""
    if isinstance(screen, RoomScreen):
        point = place_of(mark, screen, table)
        assert point is not None and mark.sigma_m is not None  # `find_mistakes` refuses others
        azimuth, elevation = (float(angle) for angle in angles_from_direction(point))
        return azimuth, elevation, mark.sigma_m / float(np.linalg.norm(point))
    azimuths = (
        None if angle is None else float(np.radians(angle))
        for angle in (mark.azimuth_deg, mark.elevation_deg)
    )
    assert mark.sigma_deg is not None
    return *azimuths, float(np.radians(mark.sigma_deg))  # type: ignore[return-value]


def place_of(mark: PlaceTable, screen: RoomScreen, table: ScreenTable) -> Array | None:
    """The point (3,) [m] of a mark from the room's origin; None if it is off the lit parts, or not given."""
    if mark.canvas_m is not None:
        return point_of(screen, mark.canvas_m)
    if mark.point_m is None or not isinstance(table, MeshTable):
        return None
    stated = np.array(mark.point_m) - np.array(table.origin_m)
    hit = screen.shape.tracer.first_hits(np.zeros(3), stated[None])
    near = np.linalg.norm(hit.points[0] * screen.shape.radius_m - stated) < OFF_M
    return stated if near and hit.faces[0] in screen.canvas.lit_faces else None


def point_of(screen: RoomScreen, canvas_m: tuple[float, float]) -> Array | None:
    """The point (3,) [m] at a position on the canvas, from its upper left corner; None off the lit parts."""
    from procam.maths.mesh.canvas import barycentric  # noqa: PLC0415 - SciPy

    corner = screen.room.place[screen.room.faces]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = barycentric(corner, np.broadcast_to(canvas_m, (len(corner), 2)))
    least = np.nan_to_num(share.min(axis=1), nan=-np.inf)
    face = int(np.argmax(least))
    if least[face] < -1e-6:
        return None
    u, v = share[face, 1:]
    tracer, unit_m = screen.shape.tracer, screen.shape.radius_m
    return np.asarray(unit_m * tracer.points_on(np.array([face]), np.array([u]), np.array([v]))[0])
