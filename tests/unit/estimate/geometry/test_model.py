"""Residuals, their derivatives and the normal equations agree with each other."""

from dataclasses import replace

import numpy as np
import pytest

from procam.estimate.geometry.model import (
    POSE,
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    camera_rays,
    normal_equations,
    points_seen,
    project_to_camera,
    residual_slopes,
    residuals,
    screen_derivatives,
)
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.ray_to_screen import RoundShape, shape_coefficient_count
from procam.model.optics import CameraModel, ProjectorModel, Sensor

RADIUS_M = 6.0
FISHEYE = Lens(
    "kannala-brandt", np.array([230.0, 231]), np.array([400.5, 397]), np.array([0.02, -0.008, 0, 0])
)
BROWN = Lens(
    "brown", np.array([575.0, 577]), np.array([642.0, 481]), np.array([-0.02, 0.002, 0.001, 0, 0])
)
STEP = 1e-6


def _rig(degree: int) -> RigGeometry:
    coefficients = np.random.default_rng(2).normal(0, 3e-4, shape_coefficient_count(degree))
    cameras = {
        name: CameraModel(
            name, (800, 800), FISHEYE, Sensor(12, 64.0), Pose.from_vectors(turn, (0.3, 0.2, -0.5))
        )
        for name, turn in (("zenith", (0.05, -0.03, 0.4)), ("second", (-0.1, 0.1, 2.0)))
    }
    cameras["second"] = replace(cameras["second"], pupil=np.array([0.004, 0.001]))
    projectors = {
        "south": ProjectorModel(
            "south", (1280, 800), BROWN, Pose.from_vectors((0.2, 0, 0), (0, 1, 2))
        ),
        "north": ProjectorModel(
            "north", (1280, 800), FISHEYE, Pose.from_vectors((0, -0.3, 1), (0.5, 0, 1))
        ),
    }
    return RigGeometry(RoundShape(RADIUS_M, coefficients, degree), cameras, projectors)


def _seen(rig: RigGeometry, count: int = 60) -> dict[Pair, Observations]:
    rng = np.random.default_rng(3)
    found = {}
    for pair in (("zenith", "south"), ("second", "south"), ("second", "north")):
        camera, projector = rig.cameras[pair[0]], rig.projectors[pair[1]]
        pixel = rng.uniform(250, 550, (count, 2))
        point = rig.shape.intersect(*camera_rays(camera, unproject(pixel, camera.lens)))
        shown = project(projector.projector_from_dome.apply(point), projector.lens)
        sigma = np.full(count, 0.1)
        found[pair] = Observations(pixel, shown + rng.normal(0, 0.1, shown.shape), sigma)
    return found


def _errors(rig: RigGeometry, seen: dict[Pair, Observations]) -> np.ndarray:
    return np.concatenate([residuals(rig, p, o).ravel() for p, o in seen.items()])


@pytest.mark.parametrize("camera", ["zenith", "second"])
def test_a_camera_sees_a_point_in_the_pixel_whose_ray_meets_it(camera: str) -> None:
    """Also one whose entrance pupil moves with the angle."""
    rig, pixel = _rig(0), np.random.default_rng(4).uniform(100, 700, (50, 2))
    found = project_to_camera(rig.cameras[camera], points_seen(rig, camera, pixel))
    np.testing.assert_allclose(found, pixel, atol=1e-5)


@pytest.mark.parametrize("degree", [0, 3])
def test_derivatives_by_every_parameter(degree: int) -> None:
    """Rays follow the lenses; the screen derivatives are evaluated for each rig."""
    rig = _rig(degree)
    seen, layout = _seen(rig), ParameterLayout.of(rig)
    slopes = np.zeros((sum(2 * len(o.sigma_px) for o in seen.values()), layout.count))
    at = 0
    for pair, some in seen.items():
        error, part = residual_slopes(rig, pair, some)
        np.testing.assert_allclose(error, residuals(rig, pair, some), atol=1e-9)
        slopes[at : at + error.size, layout.columns(pair)] = part.reshape(error.size, -1)
        at += error.size
    for i, step in enumerate(STEP * np.eye(layout.count)):
        difference = (_errors(rig.moved(step), seen) - _errors(rig.moved(-step), seen)) / (2 * STEP)
        size = np.abs(slopes[:, i]).max() + 1
        np.testing.assert_allclose(
            slopes[:, i], difference, atol=(1e-4 if degree else 1e-6) * size, err_msg=f"{i}"
        )


@pytest.mark.parametrize("fixed", [False, True], ids=["lenses-free", "lenses-fixed"])
@pytest.mark.parametrize("degree", [0, 3])
def test_normal_equations_are_products_of_the_derivatives(degree: int, fixed: bool) -> None:
    rig = _rig(degree)
    seen, layout = _seen(rig), ParameterLayout.of(rig)
    free = np.ones(layout.count, bool)
    free[[2, 9, 30, 41]] = False
    rays = {p: unproject(o.camera_px, rig.cameras[p[0]].lens) for p, o in seen.items()}
    weight = {p: np.linspace(1, 2, len(o.sigma_px)) for p, o in seen.items()}
    derivatives = {p: screen_derivatives(rig, p[0], ray) for p, ray in rays.items()}
    found = normal_equations(rig, seen, weight, free, rays if fixed else {}, derivatives)
    matrix, gradient = np.zeros((layout.count,) * 2), np.zeros(layout.count)
    for pair, some in seen.items():
        error, slopes = residual_slopes(rig, pair, some)
        every = np.zeros((error.size, layout.count))
        every[:, layout.columns(pair)] = slopes.reshape(error.size, -1)
        every *= free
        if fixed:  # of the camera its pose is solved for alone
            every[:, layout.cameras[pair[0]]][:, POSE:] = 0
        root = np.repeat(weight[pair], 2)
        matrix += every.T @ (root[:, None] * every)
        gradient += every.T @ (root * error.ravel())
    np.testing.assert_allclose(found[0], matrix, rtol=1e-9, atol=1e-9 * np.abs(matrix).max())
    np.testing.assert_allclose(found[1], gradient, rtol=1e-9, atol=1e-9 * np.abs(gradient).max())
