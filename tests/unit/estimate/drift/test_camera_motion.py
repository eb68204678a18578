"""A camera that moved, projectors that moved, and both."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from procam.arrays import Array
from procam.estimate.drift.camera_motion import Seen, find_camera_motion
from procam.estimate.geometry.model import project_to_camera
from procam.model.calibration import Calibration
from procam.model.optics import CameraModel

NOISE_PX = 0.01
See = Callable[..., dict[str, Seen]]


@pytest.fixture
def camera(calibration: Calibration) -> CameraModel:
    return calibration.cameras["zenith"]


def turned(camera: CameraModel, degrees: float, shift_m: float = 0.0) -> CameraModel:
    assert camera.camera_from_dome is not None
    step = np.r_[np.radians(degrees) * np.array([0.6, 0.0, 0.8]), shift_m, 0.0, 0.0]
    return replace(camera, camera_from_dome=camera.camera_from_dome.moved(step))


@pytest.fixture
def see(rng: np.random.Generator) -> See:
    """Points of some projectors as a camera sees them; those of `moved` are elsewhere by pixels (2,)."""

    def seen(now: CameraModel, names: str, **moved: Array) -> dict[str, Seen]:
        found = {}
        for at, name in enumerate(names):
            azimuth = 2 * np.pi * at / len(names) + rng.uniform(-0.7, 0.7, 30)
            elevation = rng.uniform(0.2, 1.3, 30)
            point = 6.0 * np.stack(
                [
                    np.cos(azimuth) * np.cos(elevation),
                    np.sin(azimuth) * np.cos(elevation),
                    np.sin(elevation),
                ],
                1,
            )
            pixel = project_to_camera(now, point) + rng.normal(0, NOISE_PX, (30, 2))
            found[name] = Seen(point, pixel + moved.get(name, np.zeros(2)), np.full(30, NOISE_PX))
        return found

    return seen


def test_a_camera_that_moved_is_placed(camera: CameraModel, see: See) -> None:
    now = turned(camera, 1.3, 0.02)
    found = find_camera_motion(camera, see(now, "abc"))
    assert found.moved and set(found.unmoved) == set("abc")
    assert abs(found.turned_deg - 1.3) < 4 * found.turned_sigma < 0.1
    assert abs(found.shifted_mm - 20) < 4 * found.shifted_sigma < 20


def test_a_projector_that_moved_is_no_camera(camera: CameraModel, see: See) -> None:
    found = find_camera_motion(camera, see(camera, "abc", b=np.array([0.8, -0.3])))
    assert not found.moved and set(found.unmoved) == {"a", "c"}


def test_a_picture_that_is_slightly_off_does_not_bend_the_pose(
    camera: CameraModel, see: See
) -> None:
    """A projector out of focus seems off by hundredths of a pixel, about what a pose can take up."""
    for away in np.arange(0.03, 0.07, 0.005):
        found = find_camera_motion(camera, see(camera, "abcd", c=np.array([away, 0.0])))
        assert not found.moved and found.camera is camera


def test_a_blurred_picture_does_not_keep_a_camera_where_it_was(
    camera: CameraModel, see: See
) -> None:
    """Its own place is uncertain by more than the camera crept, and is off the other way."""
    now = turned(camera, 0.35)
    seen = see(now, "abcd")
    crept = project_to_camera(now, seen["c"].point) - project_to_camera(camera, seen["c"].point)
    seen["c"] = replace(seen["c"], pixel=seen["c"].pixel - 1.1 * crept, sigma=np.full(30, 0.1))
    found = find_camera_motion(camera, seen)
    assert found.moved and set(found.unmoved) >= set("abd")


def test_both_moved(camera: CameraModel, see: See) -> None:
    now = turned(camera, 1.0)
    found = find_camera_motion(camera, see(now, "abcd", c=np.array([0.9, 0.4])))
    assert found.moved and set(found.unmoved) == set("abd")
    assert abs(found.turned_deg - 1.0) < 4 * found.turned_sigma


def test_two_projectors_that_moved_apart_are_no_camera(camera: CameraModel, see: See) -> None:
    """Each alone could be seen by a camera that moved."""
    a, b = (see(turned(camera, degrees), "ab") for degrees in (0.8, -1.2))
    found = find_camera_motion(camera, {"a": a["a"], "b": b["b"]})
    assert not found.moved and found.unmoved == ()


def test_one_projector_says_nothing_of_the_camera(camera: CameraModel, see: See) -> None:
    found = find_camera_motion(camera, see(camera, "a", a=np.array([2.0, 0.0])))
    assert not found.moved or found.unmoved == ("a",)


def test_no_projector_seen(camera: CameraModel) -> None:
    assert not find_camera_motion(camera, {}).moved


def test_the_angle_has_the_spread_that_its_sigma_says(camera: CameraModel, see: See) -> None:
    now = turned(camera, 0.7)
    found = [find_camera_motion(camera, see(now, "abc")) for _ in range(40)]
    z = [(each.turned_deg - 0.7) / each.turned_sigma for each in found]
    assert 0.6 < np.std(z) < 1.6 and abs(np.mean(z)) < 0.8
