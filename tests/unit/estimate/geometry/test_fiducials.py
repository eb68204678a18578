"""Derivatives of fiducial residuals by every parameter of the rig, against differences."""

from dataclasses import replace

import numpy as np
import pytest
from domes import SimulatedDome

from procam.estimate.geometry.fiducials import fiducial_residuals, fiducial_rows
from procam.estimate.geometry.model import ParameterLayout, RigGeometry
from procam.maths.geometry.ray_to_screen import RoundShape, shape_coefficient_count
from procam.model.optics import Distance, Fiducial


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
