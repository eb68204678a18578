"""The screen that [screen] of venue.toml describes, and places on it."""

from functools import cache

import numpy as np

from procam.arrays import Array
from procam.files.venue.tables import BoxTable, CylinderTable, DomeTable, PlaceTable, ScreenTable
from procam.maths.geometry.sphere import angles_from_direction
from procam.model.screen import Dome, RoomScreen, Screen

USUAL_RADIUS_M = 5.0  # initial value where none was measured
PARTS = {
    "box": ("left", "front", "right", "back", "floor", "ceiling"),
    "cylinder": ("wall", "floor"),
}
Angles = tuple[float | None, float | None, float]  # azimuth, elevation, sigma [rad]
one_room = cache(RoomScreen)  # its mesh takes a while


def screen_of(table: ScreenTable) -> Screen:
    """The screen of a table; a dome has `USUAL_RADIUS_M` where its radius is not known."""
    if isinstance(table, DomeTable):
        return Dome(
            table.radius_m or USUAL_RADIUS_M,
            float(np.radians(table.half_angle_deg)),
            float(np.radians(table.tilt_deg)),
            table.floor_albedo,
            table.floor_albedo_sigma,
        )
    return _room(table)


def _room(table: BoxTable | CylinderTable) -> RoomScreen:
    if isinstance(table, BoxTable):
        size, lit = (table.width_m, table.depth_m, table.height_m), tuple(map(str, table.lit))
    else:
        size, lit = (table.radius_m, table.arc_deg, table.height_m), ("wall",)
    usual = table.other_albedo, table.other_albedo_sigma
    stated = {str(name): given for name, given in table.others.items()}
    others = [(name, *stated.get(name, usual)) for name in PARTS[table.kind] if name not in lit]
    return one_room(table.kind, size, lit, tuple(others))


def canvas_size_m(table: BoxTable | CylinderTable) -> tuple[float, float]:
    """Width and height of a room's canvas [m]."""
    screen = screen_of(table)
    assert isinstance(screen, RoomScreen)
    return screen.room.size_m


def angles_of(mark: PlaceTable, screen: Screen) -> Angles:
    """Azimuth and elevation of a mark, None where not known, and their standard error [rad]."""
    if isinstance(screen, RoomScreen):
        assert (
            mark.canvas_m is not None and mark.sigma_m is not None
        )  # `find_mistakes` refuses others
        point = point_of(screen, mark.canvas_m)
        assert point is not None
        azimuth, elevation = (float(angle) for angle in angles_from_direction(point))
        return azimuth, elevation, mark.sigma_m / float(np.linalg.norm(point))
    azimuths = (
        None if angle is None else float(np.radians(angle))
        for angle in (mark.azimuth_deg, mark.elevation_deg)
    )
    assert mark.sigma_deg is not None
    return *azimuths, float(np.radians(mark.sigma_deg))  # type: ignore[return-value]


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
