"""Usual mistakes, each made on a simulated rig and named; none where nothing is wrong."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from domes import SimulatedDome

from procam.errors import CalibrationError
from procam.estimate.geometry.adjustment import RigProblem
from procam.estimate.geometry.diagnosis import find_causes
from procam.estimate.geometry.model import Observations, Pair
from procam.estimate.geometry.solve import GeometrySolution, solve_geometry
from procam.maths.geometry.pose import Pose, rotation_matrix
from simulators.presets import REALISTIC, STANDARD

Seen = dict[Pair, Observations]


def _solved(problem: RigProblem) -> GeometrySolution | None:
    try:
        return solve_geometry(problem)
    except CalibrationError:
        return None


def _causes_of(problem: RigProblem) -> list[str]:
    return find_causes(problem, _solved(problem))


def _warped(seen: Seen, name: str, matrix: np.ndarray) -> Seen:
    """What cameras see if a projector warps its picture by a homography before it shows it."""

    def warp(some: Observations) -> Observations:
        # a content pixel q is shown by panel pixel matrix q: cameras read q at that place
        place = np.c_[some.projector_px, np.ones(len(some.sigma_px))] @ np.linalg.inv(matrix).T
        return replace(some, projector_px=place[:, :2] / place[:, 2:])

    return {p: warp(o) if p[1] == name else o for p, o in seen.items()}


def _merged(before: Seen, after: Seen, camera: str, later: set[str]) -> Seen:
    return {p: after[p] if p[0] == camera and p[1] in later else o for p, o in before.items()}


@pytest.mark.parametrize("preset", [STANDARD, REALISTIC])
def test_a_correct_rig_has_no_causes(preset: object) -> None:
    dome = SimulatedDome.build(7, preset, projectors=3, cameras=2)
    assert _causes_of(dome.problem(dome.observations(64))) == []


@pytest.mark.parametrize(
    ("cameras", "camera", "later", "moment"),
    [
        (2, "zenith", {"east"}, "north and east"),
        (2, "second", {"north", "east"}, "south and north"),
        (1, "zenith", {"east"}, "north and east"),
    ],
)
def test_a_camera_that_moved(cameras: int, camera: str, later: set[str], moment: str) -> None:
    dome = SimulatedDome.build(7, cameras=cameras)
    size = 1.0 if cameras > 1 else 8.0  # alone, its position follows from the dome's curvature only
    moved = [
        replace(c, camera_from_dome=_pushed(c.camera_from_dome, size)) if c.name == camera else c
        for c in dome.cameras
    ]
    seen = _merged(dome.observations(), replace(dome, cameras=moved).observations(), camera, later)
    (line,) = _causes_of(dome.problem(seen))
    assert camera in line
    assert line.endswith(f" moved between the pictures of {moment}; fix it and capture again")


def _pushed(pose: Pose, size: float) -> Pose:
    """A camera that was knocked: half a degree, a centimetre, times `size`."""
    turn = rotation_matrix(size * np.radians([0.3, -0.2, 0.4]))
    shift = size * np.array([0.01, -0.005, 0.003])
    return Pose(turn @ pose.rotation, turn @ pose.translation + shift)


@pytest.mark.parametrize("cameras", [1, 2])
def test_photographs_that_were_cropped(cameras: int) -> None:
    """A stabiliser enlarges the pictures of all cameras by 5 %; their lenses were measured without."""
    dome = SimulatedDome.build(7, projectors=3, cameras=cameras)
    sizes = {c.name: np.array(c.size) for c in dome.cameras}

    def enlarged(camera: str, pixel: np.ndarray) -> np.ndarray:
        middle = (sizes[camera] - 1) / 2
        return np.asarray(middle + 1.05 * (pixel - middle))

    seen = {
        (c, p): replace(o, camera_px=enlarged(c, o.camera_px))
        for (c, p), o in dome.observations(64).items()
    }
    marks = [replace(f, pixel=enlarged(f.device, f.pixel)) for f in dome.fiducials()]
    lines = _causes_of(dome.problem(seen, fiducials=marks))
    assert [line.split(":")[0] for line in lines] == [f"camera {c}" for c in sizes]
    found = [re.search(r"a focal length (.+)% from f in venue\.toml, as if", x) for x in lines]
    shares = [float(each.group(1)) for each in found if each]
    assert shares == pytest.approx([5.0] * cameras, abs=1.0 / cameras**2)  # one sees it worse


@pytest.mark.parametrize("alike", [False, True], ids=["lenses differ", "fiducials of both"])
def test_exchanged_cameras(alike: bool) -> None:
    dome = SimulatedDome.build(7)
    marks = dome.fiducials()
    if alike:
        one, other = dome.cameras
        dome = replace(dome, cameras=[one, replace(other, lens=one.lens)])
        marks += replace(dome, cameras=dome.cameras[::-1]).fiducials()
    name = {"zenith": "second", "second": "zenith"}
    seen = {(name[c], p): o for (c, p), o in dome.observations().items()}
    (line,) = _causes_of(dome.problem(seen, fiducials=marks))
    assert line.startswith("cameras zenith and second seem exchanged")


def test_keystone() -> None:
    dome = SimulatedDome.build(7)
    keystone = np.array([[1.0, 0, 0], [0, 1, 0], [0, 1.2e-4, 1]])
    (line,) = _causes_of(dome.problem(_warped(dome.observations(), "north", keystone)))
    assert line.startswith("projector north stretches its picture by 1.")
    assert "keystone" in line


def test_another_format() -> None:
    dome = SimulatedDome.build(7)
    scaled = np.diag([1.0, 1200 / 1080, 1.0])  # 16:9 on a panel of 16:10
    (line,) = _causes_of(dome.problem(_warped(dome.observations(), "east", scaled)))
    assert line == (
        "projector east stretches its picture by 1.111, so its pixels are not square: its input has "
        "another format than its panel; feed it its native resolution, unscaled"
    )


@dataclass(frozen=True)
class Wall:
    """A flat wall instead of a dome."""

    preset = STANDARD
    lit_half_angle = np.pi

    def intersect(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore"):
            reach = (6.0 - origin[..., 2]) / direction[..., 2]
        return origin + np.where(reach > 0, reach, np.nan)[..., None] * direction

    def radius(self, direction: np.ndarray) -> np.ndarray:
        return 6.0 / np.atleast_2d(direction)[:, 2]


def test_a_small_part_of_a_dome_is_not_a_flat_screen() -> None:
    dome = SimulatedDome.build(1)
    seen = dome.observations(16)
    some = seen["second", "south"]
    middle = np.abs(some.projector_px - [960, 600]).max(axis=1) < 200
    seen["second", "south"] = some.some(middle)
    assert _causes_of(dome.problem(seen)) == []


def test_a_flat_screen() -> None:
    dome = replace(SimulatedDome.build(7, cameras=1), surface=Wall())
    (line,) = _causes_of(dome.problem(dome.observations()))
    assert line.startswith(
        "camera zenith sees south, north, east on a flat screen (it deviates by 0."
    )
