"""Where the simulated projectors and cameras stand."""

from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.sphere import direction_from_angles
from simulators.builds import CameraBuild, ProjectorBuild
from simulators.presets import STANDARD, Preset

PROJECTOR_NAMES = ("south", "north", "east", "west", "aft", "fore")
CAMERA_NAMES = ("zenith", "second", "third", "fourth")
RIM_DISTANCE = 0.95  # of the radius: lenses just inside the rim


def place_projectors(
    count: int, size: tuple[int, int], preset: Preset = STANDARD
) -> list[ProjectorBuild]:
    """Projectors at equal angles round the rim, each pointed at the far side."""
    rng = np.random.default_rng(preset.rig_seed)
    return [
        _projector(PROJECTOR_NAMES[i], 2 * np.pi * i / count, size, preset, rng)
        for i in range(count)
    ]


def place_cameras(
    count: int, size: tuple[int, int], kind: str, preset: Preset = STANDARD
) -> list[CameraBuild]:
    """Cameras near the middle of the deck, off the dome's centre, pointed upwards."""
    places = np.array(
        [[0.08, -0.06, 0.09], [-0.3, 0.2, 0.1], [0.25, 0.3, 0.08], [-0.1, -0.35, 0.1]]
    )
    turns = [(0.05, -0.03, 0.4), (-0.06, 0.04, 2.0), (0.03, 0.07, -1.1), (0.02, -0.05, 3.0)]
    places = preset.radius_m * (places + preset.camera_shift)
    return [
        replace(_camera(CAMERA_NAMES[i], places[i], turns[i], size, kind), flaws=preset.flaws)
        for i in range(count)
    ]


def _projector(
    name: str, azimuth: float, size: tuple[int, int], preset: Preset, rng: np.random.Generator
) -> ProjectorBuild:
    (width, height), spread = size, preset.rig_spread
    place = preset.radius_m * np.array(
        [-RIM_DISTANCE * np.cos(azimuth), -RIM_DISTANCE * np.sin(azimuth), 0.08]
    )
    ahead, up = azimuth + rng.normal(0, 0.02 * spread), np.radians(15 + rng.normal(0, spread))
    aim = direction_from_angles(ahead, up)
    mix = _colour_mix(rng)
    return ProjectorBuild(
        name,
        size,
        Lens(
            "brown",
            np.array([0.45, 0.45]) * width * (1 + rng.normal(0, 0.004)),
            np.array([0.5 * width + rng.normal(0, 4), 0.6 * height + rng.normal(0, 4)]),
            np.array([-0.02, 0.002, 0.0, 0.0, 0.0]) * (1 + rng.normal(0, 0.1)),
        ),
        level_pose(place, aim),
        mix,
        gamma=np.array([2.2, 2.25, 2.15]) * (1 + rng.normal(0, 0.01, 3)),
        toe=rng.uniform(0.02, 0.08, 3),
        falloff=0.65,
        black=1 / 1500,
    )


def panel_colours(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Colour mix (3, 3), gamma (3,) and toe (3,) of a projector drawn at random."""
    mix = _colour_mix(rng)
    return (
        mix,
        np.array([2.2, 2.25, 2.15]) * (1 + rng.normal(0, 0.01, 3)),
        rng.uniform(0.02, 0.08, 3),
    )


def _colour_mix(rng: np.random.Generator) -> Array:
    mix = np.array([[1.0, 0.06, 0.01], [0.05, 1.0, 0.07], [0.01, 0.05, 1.0]])
    mix = mix * (1 + rng.normal(0, 0.03, (3, 3)))
    white = np.array([0.95, 1.0, 0.9]) * (1 + rng.normal(0, 0.04, 3))
    return np.asarray(mix / mix.sum(axis=1, keepdims=True) * white[:, None])


def _camera(
    name: str, place: Array, turn: tuple[float, ...], size: tuple[int, int], kind: str
) -> CameraBuild:
    rotation = Pose.from_vectors(turn, np.zeros(3)).rotation  # upwards, image x to the front
    centre = (np.array(size) - 1) / 2 + [3.3, -2.1]
    if kind == "pinhole":
        focal, k = np.full(2, 0.4 * min(size)), np.zeros(5)
        lens = Lens("brown", focal, centre, k)
    else:
        focal = np.full(2, min(size) / 2 / 1.72)  # the edge is 98 degrees off the axis
        lens = Lens("kannala-brandt", focal, centre, np.array([0.02, -0.008, 0.001, 0.0]))
    return CameraBuild(name, size, lens, Pose(rotation, -rotation @ place))


def level_pose(place: Array, aim: Array) -> Pose:
    """Pose of a level device at `place` pointed along `aim` (x right, y down, z forward)."""
    right = np.cross(aim, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(aim, right), aim])
    return Pose(rotation, -rotation @ place)
