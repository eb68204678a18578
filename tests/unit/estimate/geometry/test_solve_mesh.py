"""Rigs solved on mesh screens, with observations from closed forms."""

from dataclasses import dataclass, replace

import mesh_shapes
import numpy as np
import pytest
from domes import SimulatedDome, step_between

from procam.errors import NotEnoughData
from procam.estimate.geometry.model import ParameterLayout
from procam.estimate.geometry.solve import GeometrySolution, solve_geometry
from procam.maths.geometry.sphere import intersect_sphere
from procam.maths.mesh.shape import MeshShape
from simulators.presets import STANDARD

LOW, HIGH = (-8.5, -7.6, -2.0), (8.3, 7.9, 6.5)
HEIGHT_M = 9.0


@dataclass(frozen=True)
class Room:
    """A room instead of a dome; every ray from inside meets the nearest wall ahead."""

    kind: str
    preset = STANDARD
    lit_half_angle = np.radians(105)

    def intersect(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        if self.kind == "box":
            walls = np.where(direction > 0, HIGH, LOW)
            reach = ((walls - origin) / direction).min(axis=-1)
        else:  # a drum under a flat ceiling, round the origin
            flat = direction * [1, 1, 0]
            size = np.linalg.norm(flat, axis=-1)
            reach = (
                np.linalg.norm(
                    intersect_sphere(origin * [1, 1, 0], flat / size[..., None], 8.0)
                    - origin * [1, 1, 0],
                    axis=-1,
                )
                / size
            )
            up = np.where(direction[..., 2] > 0, 6.0, -3.0)
            reach = np.minimum(reach, (up - origin[..., 2]) / direction[..., 2])
        return origin + reach[..., None] * direction

    def radius(self, direction: np.ndarray) -> np.ndarray:
        return np.linalg.norm(self.intersect(np.zeros(3), np.atleast_2d(direction))[0], axis=-1)

    def shape(self) -> MeshShape:
        if self.kind == "box":
            return MeshShape.of(*mesh_shapes.box(LOW, HIGH))
        vertices, faces = mesh_shapes.cylinder(8.0, HEIGHT_M, 720, closed=True)
        return MeshShape.of(vertices - [0, 0, 3.0], faces, smooth=True)


def _rig(kind: str, seed: int = 3, **how: int) -> SimulatedDome:
    return replace(SimulatedDome.build(seed, **how), surface=Room(kind))


def _solved(dome: SimulatedDome, sigma_px: float) -> GeometrySolution:
    return solve_geometry(
        dome.problem(
            dome.observations(40, sigma_px),
            shape=dome.surface.shape(),
            fiducials=dome.fiducials(count=5, off=float(sigma_px > 0)),
        )
    )


@pytest.mark.parametrize("kind", ["box", "drum"])
def test_exact_observations_give_the_exact_rig(kind: str) -> None:
    dome = _rig(kind, projectors=2)
    found = _solved(dome, 0.0)
    step = step_between(found.rig, dome.rig())
    layout = ParameterLayout.of(found.rig)
    for block in (*layout.cameras.values(), *layout.projectors.values()):
        assert np.abs(step[block][:6]).max() < (1e-12 if kind == "box" else 1e-8)  # rad, m
    assert len(found.freedoms) == 0


@pytest.mark.parametrize("kind", ["box", "drum"])
def test_errors_of_directions_agree_with_their_sigma(kind: str) -> None:
    dome = _rig(kind, projectors=2)
    found = _solved(dome, 0.02)
    assert max(found.scale.values()) < 1.1
    error, sigma = dome.direction_errors(found)
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert 0.3 < np.mean((error / sigma) ** 2) < 2


def test_a_mesh_needs_four_fiducials() -> None:
    dome = _rig("box", projectors=2)
    problem = dome.problem(dome.observations(64), shape=dome.surface.shape())
    with pytest.raises(
        NotEnoughData, match=r"fiducials: no camera sees more than 3 .* needs 4 or more"
    ):
        solve_geometry(problem)
