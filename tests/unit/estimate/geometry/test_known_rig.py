"""One projector solved in a rig that is known otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from domes import SimulatedDome, step_between

from procam.errors import CalibrationError
from procam.estimate.geometry.known_rig import solve_projectors
from procam.estimate.geometry.model import Observations, ParameterLayout, RigGeometry


def before(dome: SimulatedDome, name: str) -> RigGeometry:
    """The rig as it was before a projector was nudged by half a degree."""
    rig = dome.rig()
    old = rig.projectors[name]
    pose = old.projector_from_dome.moved(np.array([0.005, -0.007, 0.002, 0, 0.01, 0]))
    return replace(rig, projectors={**rig.projectors, name: replace(old, projector_from_dome=pose)})


@pytest.mark.parametrize("cameras", [1, 2])
def test_exact_observations_give_the_exact_projector_and_leave_the_rest(cameras: int) -> None:
    dome = SimulatedDome.build(4, projectors=3, cameras=cameras)
    name = dome.projectors[1].name
    known = before(dome, name)
    found = solve_projectors(dome.problem(dome.observations(48, 0.0)), known, [name], main="zenith")
    layout, step = ParameterLayout.of(found.rig), step_between(found.rig, dome.rig())
    assert np.abs(step[layout.projectors[name]][:6]).max() < 1e-6
    for other in known.projectors:
        if other != name:
            assert found.rig.projectors[other] is known.projectors[other]
    assert found.rig.cameras == known.cameras and found.rig.shape is known.shape
    assert set(found.scale) == set(found.observations) == set(found.residual_px)


def test_errors_agree_with_the_covariance() -> None:
    total, count = 0.0, 0
    for seed in range(6):
        dome = SimulatedDome.build(seed, projectors=2)
        name = dome.projectors[0].name
        found = solve_projectors(
            dome.problem(dome.observations(48)), before(dome, name), [name], main="zenith"
        )
        covariance = found.rig.projectors[name].covariance
        assert covariance is not None
        block = ParameterLayout.of(found.rig).projectors[name]
        step = step_between(found.rig, dome.rig())[block]
        root = np.sqrt(np.diag(covariance))
        total += float(
            (step / root) @ np.linalg.solve(covariance / np.outer(root, root), step / root)
        )
        count += len(step)
    assert abs(total - count) < 4 * np.sqrt(2 * count)


def test_a_projector_that_is_hardly_seen_is_refused() -> None:
    dome = SimulatedDome.build(2, projectors=2, cameras=1)
    name, seen = dome.projectors[0].name, dome.observations(48)
    few = {pair: o.some(slice(0, 5)) if pair[1] == name else o for pair, o in seen.items()}
    with pytest.raises(CalibrationError, match=name):
        solve_projectors(dome.problem(few), before(dome, name), [name], main="zenith")


def test_misread_patches_are_rejected() -> None:
    dome = SimulatedDome.build(3, projectors=2, cameras=1)
    name, seen = dome.projectors[0].name, dome.observations(48)
    (pair,) = (pair for pair in seen if pair[1] == name)
    wrong = seen[pair].projector_px.copy()
    wrong[::10] += 40.0
    seen[pair] = Observations(seen[pair].camera_px, wrong, seen[pair].sigma_px)
    found = solve_projectors(dome.problem(seen), before(dome, name), [name], main="zenith")
    step = step_between(found.rig, dome.rig())[ParameterLayout.of(found.rig).projectors[name]]
    assert np.abs(step[:3]).max() < 2e-4
