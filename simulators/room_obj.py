"""The room of the shape of an L as its owner has it: an OBJ file with groups and texture coordinates.

`python -m simulators.room_obj` prints it; it wrote calib_data/venues/simulated-room/room.obj.
"""

import json
import sys

import numpy as np

from simulators.walls import Wall, walls_of

L_LENGTHS = {
    "width_m": 6.0,
    "depth_m": 5.0,
    "height_m": 3.0,
    "cut_width_m": 2.5,
    "cut_depth_m": 2.0,
}
L_LIT = ("front", "inner-front", "floor", "inner-floor")
# upper left corners [m] of lit walls on the canvas, where the floor has its shape, and the canvas's size
L_CANVAS = {
    "front": (0.0, 0.0),
    "inner-front": (3.5, 0.0),
    "floor": (0.0, 3.0),
    "inner-floor": (3.5, 5.0),
}
CANVAS_M = (6.0, 8.0)
GROUP_OF = {"inner-floor": "floor", "inner-ceiling": "ceiling"}
GROUPS = tuple(dict.fromkeys(GROUP_OF.get(name, name) for name in L_LIT))
MESH_KEYS = f"""\
kind = "mesh"
file = "room.obj"        # in metres, beside this file; its groups are the parts of the room
lit = {json.dumps(GROUPS)}   # groups that projectors light
canvas = [1536, 2048]    # pixels of the pictures that its texture coordinates were made for
"""
CORNERS = np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)])


def obj_text() -> str:
    """The OBJ file of the room."""
    lines, group = ["# metres; texture coordinates of what is lit"], ""
    vertices = textures = 0
    for wall in walls_of("L", L_LENGTHS):
        if (name := GROUP_OF.get(wall.name, wall.name)) != group:
            lines.append(f"g {name}")
            group = name
        u, v = CORNERS.T
        lines += [f"v {x:g} {y:g} {z:g}" for x, y, z in wall.points(u, v)]
        lines += _texture(wall)
        corners = [str(vertices + i) for i in range(1, 5)]
        if wall.name in L_CANVAS:
            corners = [f"{corner}/{textures + i}" for i, corner in enumerate(corners, 1)]
            textures += 4
        lines.append(f"f {' '.join(corners)}")
        vertices += 4
    return "\n".join(lines) + "\n"


def _texture(wall: Wall) -> list[str]:
    if wall.name not in L_CANVAS:
        return []
    places = (np.array(L_CANVAS[wall.name]) + CORNERS * wall.size_m) / CANVAS_M
    return [f"vt {u:.9g} {1 - v:.9g}" for u, v in places]


if __name__ == "__main__":
    sys.stdout.write(obj_text())
