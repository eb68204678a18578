"""Derivatives of fiducial residuals by every parameter of the rig, against differences."""

from dataclasses import replace

import mesh_shapes
import numpy as np
import pytest
from domes import SimulatedDome

from procam.estimate.geometry.fiducials import (
    fiducial_residuals,
    fiducial_rows,
    with_camera_errors,
)
from procam.estimate.geometry.model import ParameterLayout, RigGeometry
from procam.maths.geometry.lenses import Lens
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.ray_to_screen import RoundShape, shape_coefficient_count
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import CameraModel, Distance, Fiducial, Sensor


@pytest.mark.parametrize("degree", [0, 4])
def test_derivatives_are_those_of_the_residuals(degree: int) -> None:
    dome = SimulatedDome.build(2, projectors=2, cameras=2)
    coefficients = np.random.default_rng(1).normal(0, 3e-4, shape_coefficient_count(degree))
    rig = RigGeometry(
        RoundShape(8.0, coefficients, degree), dome.rig().cameras, dome.rig().projectors
    )
    name = dome.cameras[0].name
    pupil = replace(rig.cameras[name], pupil=np.array([0.003, 0.001]))
    rig = RigGeometry(rig.shape, {**rig.cameras, name: pupil}, rig.projectors)
    seen = dome.fiducials(1e-3)
    shown = Fiducial("shown", 0.4, 0.5, 1e-3, "south", np.array([900.0, 500.0]))
    marks = [*seen, replace(seen[0], azimuth=None), replace(shown, elevation=None), shown]
    distances = [
        Distance("zenith", "south", 5.0, 0.01),
        Distance("front", "shown", 7.0, 0.01),
        Distance("second", "left", 7.0, 0.01),
    ]
    error, slopes = fiducial_rows(rig, marks, distances)
    np.testing.assert_array_equal(error, fiducial_residuals(rig, marks, distances))
    for i in range(ParameterLayout.of(rig).count):
        step = np.zeros(ParameterLayout.of(rig).count)
        step[i] = 1e-6
        ahead, behind = (fiducial_residuals(rig.moved(s), marks, distances) for s in (step, -step))
        size = 1 + np.abs(slopes[:, i]).max()
        np.testing.assert_allclose((ahead - behind) / 2e-6, slopes[:, i], atol=2e-6 * size)


@pytest.mark.parametrize(("x", "larger"), [(2.0, 0.2), (-7.0, 2.0)])
def test_a_pixels_error_in_a_room_is_an_angle_about_its_origin(x: float, larger: float) -> None:
    """A camera that looks at a wall 3 m ahead of the origin, on which a mark is 4 m to the left.

    A pixel's error about the camera is as many metres up the wall as the camera is away from it; they are
    seen from 5 m away.
    """
    vertices, faces = mesh_shapes.box((-9.0, -10.0, -10.0), (3.0, 10.0, 10.0))
    ahead = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    focal, sigma, seen = 500.0, 2e-3, 1e-3
    lens = Lens("brown", np.full(2, focal), np.zeros(2), np.zeros(5))
    pose = Pose(ahead, -ahead @ np.array([x, 0.0, 0.0]))
    camera = CameraModel("c", (1000, 1000), lens, Sensor(12, 64.0), pose)
    pixel = np.array([-4 * focal / (3 - x), 0.0])
    mark = Fiducial("mark", 0.1, 0.0, sigma, "c", pixel, seen)
    for shape, factor in ((MeshShape.of(vertices, faces), larger), (RoundShape(8.0), 1.0)):
        (found,) = with_camera_errors(RigGeometry(shape, {"c": camera}, {}), [mark])
        assert found.sigma == pytest.approx(np.sqrt(sigma**2 + (factor**2 - 1) * seen**2), rel=1e-3)
