"""Where the projectors and cameras of a simulated room of walls stand."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from simulators.builds import CameraBuild, ProjectorBuild
from simulators.placement import CAMERA_NAMES, PROJECTOR_NAMES, level_pose, panel_colours
from simulators.walled_room import WalledSurface
from simulators.walls import ArcWall, Wall

OVERSPILL = 1.08  # of a picture over its wall
NEAR_CEILING = 0.38  # of the room's height above its middle
FARTHEST = 0.9  # of the room's depth before a wall, from which a projector throws
SIDES = (
    (0.42, 0.33),
    (0.35, -0.36),
    (0.1, 0.1),
    (0.4, 0.0),
)  # of the room, backwards and to the left
TURNS_DEG = ((-14.0, 4.0), (12.0, 2.0), (3.0, 30.0), (0.0, -5.0))  # to the left and upwards


def place_wall_projectors(
    surface: WalledSurface, count: int, size: tuple[int, int]
) -> list[ProjectorBuild]:
    """A projector for each lit flat wall, named after it, and `count` along an arc."""
    rng = np.random.default_rng(surface.preset.rig_seed)
    builds = list[ProjectorBuild]()
    for wall in surface.walls:
        if wall.name not in surface.lit:
            continue
        if isinstance(wall, ArcWall):
            builds += [_on_arc(wall, i, count, size, rng) for i in range(count)]
        else:
            builds.append(_before(wall, surface, size, rng))
    return builds


def place_wall_cameras(
    surface: WalledSurface, count: int, size: tuple[int, int]
) -> list[CameraBuild]:
    """Fisheyes at the back of the room, pointed to its front."""
    corners = _corners(surface.walls)
    middle, room_m = (corners.max(axis=0) + corners.min(axis=0)) / 2, np.ptp(corners, axis=0)
    builds = []
    for name, (back, left), turn in zip(CAMERA_NAMES[:count], SIDES, TURNS_DEG, strict=False):
        place = middle + room_m * [-back, left, 0.12]
        azimuth, elevation = np.radians(turn)
        aim = np.array([np.cos(azimuth), np.sin(azimuth), np.sin(elevation)])
        lens = Lens(
            "kannala-brandt",
            np.full(2, min(size) / 2 / 1.72),
            (np.array(size) - 1) / 2 + [3.3, -2.1],
            np.array([0.02, -0.008, 0.001, 0.0]),
        )
        pose = level_pose(place, aim / np.linalg.norm(aim))
        builds.append(replace(CameraBuild(name, size, lens, pose), flaws=surface.preset.flaws))
    return builds


def _corners(walls: Sequence[Wall]) -> Array:
    at = np.linspace(0, 1, 9)
    u, v = (grid.ravel() for grid in np.meshgrid(at, at))
    return np.concatenate([wall.points(u, v) for wall in walls])


def _before(
    wall: Wall, surface: WalledSurface, size: tuple[int, int], rng: np.random.Generator
) -> ProjectorBuild:
    """A projector opposite of a flat wall, whose shifted lens makes its picture cover the wall."""
    height_m = float(np.ptp(_corners(surface.walls)[:, 2]))
    middle = wall.points(np.array(0.5), np.array(0.5))
    inwards = wall.inwards(middle)
    level = abs(inwards[2]) < 0.5
    across_m, down_m = wall.size_m
    deepest = FARTHEST * float(surface.cast(middle, inwards[None]).distance[0])
    distance = min(1.2 * across_m, deepest)
    rise = NEAR_CEILING * height_m if level else 0.0
    place = middle + distance * inwards + [0, 0, rise] + rng.normal(0, 0.03, 3)
    focal = min(size[0] / across_m, size[1] / down_m) * distance / OVERSPILL
    shift = np.array([0.0, -focal * rise / distance])
    centre = np.array(size) / 2 + shift + rng.normal(0, 4, 2)
    aim = -inwards + rng.normal(0, 0.01, 3)
    pose = level_pose(place, aim / np.linalg.norm(aim)) if level else _downwards(place, aim)
    return _build(wall.name, size, focal, centre, pose, rng)


def _on_arc(
    wall: ArcWall, index: int, count: int, size: tuple[int, int], rng: np.random.Generator
) -> ProjectorBuild:
    """One of `count` projectors that light equal parts of an arc, from below its axis's upper end."""
    part = wall.arc / count
    azimuth = wall.arc / 2 - part * (index + 0.5)
    away = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    height_m = wall.size_m[1]
    place = -0.15 * wall.radius_m * away + [0, 0, NEAR_CEILING * height_m] + rng.normal(0, 0.03, 3)
    half_width = np.sin(part / 2) * wall.radius_m
    distance = 0.15 * wall.radius_m + np.cos(part / 2) * wall.radius_m
    widths = size[0] / (2 * OVERSPILL * half_width), size[1] / (1.3 * height_m)
    focal = min(widths) * distance
    centre = np.array(size) / 2 + [0, -focal * NEAR_CEILING * height_m / (1.15 * wall.radius_m)]
    aim = away + rng.normal(0, 0.01, 3)
    name = PROJECTOR_NAMES[index]
    pose = level_pose(place, aim / np.linalg.norm(aim))
    return _build(name, size, focal, centre + rng.normal(0, 4, 2), pose, rng)


def _downwards(place: Array, aim: Array) -> Pose:
    """A pose that looks along a steep direction, the upper edge of its picture to the front."""
    aim = aim / np.linalg.norm(aim)
    down = -np.array([1.0, 0.0, 0.0]) * np.sign(-aim[2])
    right = np.cross(down, aim)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(aim, right), aim])
    return Pose(rotation, -rotation @ place)


def _build(
    name: str,
    size: tuple[int, int],
    focal: float,
    centre: Array,
    pose: Pose,
    rng: np.random.Generator,
) -> ProjectorBuild:
    mix, gamma, toe = panel_colours(rng)
    lens = Lens(
        "brown",
        np.full(2, focal * (1 + rng.normal(0, 0.004))),
        centre,
        np.array([-0.02, 0.002, 0.0, 0.0, 0.0]) * (1 + rng.normal(0, 0.1)),
    )
    return ProjectorBuild(
        name, size, lens, pose, mix, gamma=gamma, toe=toe, falloff=0.3, black=1 / 1500
    )
