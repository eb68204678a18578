"""Resection without start values."""

import numpy as np
import pytest
from domes import SimulatedDome

from procam.errors import NotEnoughData
from procam.estimate.geometry.model import RigGeometry
from procam.estimate.geometry.start import (
    add_camera,
    check_projectors_placed,
    initial_rigs,
    resect_by_rays,
    resect_projectors,
)
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.sphere import normalise


def test_rays_to_known_points_give_the_pose(rng: np.random.Generator) -> None:
    pose = Pose.from_vectors((0.3, -0.2, 1.0), (0.5, 0.4, -0.7))
    points = 8.0 * normalise(rng.normal([0, 0, 1.0], 1.0, (30, 3)))
    found = resect_by_rays(normalise(pose.apply(points)), points, 8.0)
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-6)
    np.testing.assert_allclose(found.translation, pose.translation, atol=1e-5)


def test_projectors_and_a_second_camera_follow_from_the_first() -> None:
    dome = SimulatedDome.build(2, projectors=2)
    seen, truth = dome.observations(48, 0.0), dome.rig()
    problem = dome.problem(seen)
    alone = RigGeometry(truth.shape, {"zenith": truth.cameras["zenith"]}, {})
    rig = resect_projectors(alone, problem.projectors, seen)
    rig = add_camera(rig, problem.cameras["second"], problem.projectors, seen)
    check_projectors_placed(rig, problem.projectors)
    # the direct linear transform ignores distortion: decimetres off a sphere of 8 m
    for name, projector in truth.projectors.items():
        found = rig.projectors[name].projector_from_dome.origin
        np.testing.assert_allclose(found, projector.projector_from_dome.origin, atol=0.3)
    found = rig.cameras["second"].camera_from_dome.origin
    np.testing.assert_allclose(found, truth.cameras["second"].camera_from_dome.origin, atol=0.1)


def test_starts_are_sorted_and_a_missing_projector_is_named() -> None:
    dome = SimulatedDome.build(2, projectors=2)
    seen = {p: o for p, o in dome.observations(48).items() if p[1] == "south"}
    problem = dome.problem(seen)
    rigs = initial_rigs(problem.cameras["zenith"], problem.shape, problem.projectors, seen)
    assert len(rigs) > 1
    with pytest.raises(NotEnoughData, match="projector north: no camera with a pose"):
        check_projectors_placed(rigs[0], problem.projectors)
