"""Where light and lines of sight end in a room, whatever its shape."""

from typing import NamedTuple

from procam.arrays import Array, Array32, BoolArray, IndexArray


class LitPixels(NamedTuple):
    """Where a projector's pixels (H, W) land.

    `place` (H, W, 3): on a dome the unit direction from its centre, on walls the point [m]. `weight`: of the
    pixel in the surface's unit, its solid angle from the centre [sr] or its area [m^2]. `area_m2`: its area.
    `lit`: it passes the blackout plates. `patch`: the room's patch under it. `albedo`: of the paint.
    """

    place: Array
    weight: Array
    area_m2: Array
    lit: BoolArray
    patch: IndexArray
    albedo: Array


class Ends(NamedTuple):
    """Where lines of sight (H, W) end.

    `on_screen`: on the dome or a wall. `point`, `outward` (H, W, 3): where [m], and the normal away from the
    room. `albedo`: of the paint there, 0 off the screen. `scatter_at` (H, W, 2): where to read the room's
    image of scattered irradiance. `below`: flat places of lines that end on what has no image, and the
    patches there.
    """

    on_screen: BoolArray
    point: Array
    outward: Array
    albedo: Array
    scatter_at: Array32
    below: tuple[IndexArray, IndexArray]
