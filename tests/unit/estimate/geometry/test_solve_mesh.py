"""Rigs solved on mesh screens, with observations from closed forms."""

from dataclasses import dataclass, replace

import mesh_shapes
import numpy as np
import pytest
from domes import SimulatedDome, step_between

from procam.errors import NotEnoughData
from procam.estimate.geometry.model import ParameterLayout
from procam.estimate.geometry.solve import GeometrySolution, solve_geometry
from procam.estimate.geometry.walls import moved_walls
from procam.maths.geometry.sphere import (
    angles_from_direction,
    direction_from_angles,
    intersect_sphere,
    normalise,
)
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import Fiducial
from simulators.observations import camera_pixels
from simulators.presets import STANDARD

LOW, HIGH = (-8.5, -7.6, -2.0), (8.3, 7.9, 6.5)
CUTS, WALLS = 6, {0: "back", 1: "front", 2: "right", 3: "left", 5: "ceiling"}
HEIGHT_M = 9.0


@dataclass(frozen=True)
class Room:
    """A room instead of a dome; every ray from inside meets the nearest wall ahead.

    The wall at the front of a box is `off_m` further out than its drawing has it.
    """

    kind: str
    off_m: float = 0.0
    preset = STANDARD
    lit_half_angle = np.radians(105)

    def intersect(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        if self.kind == "box":
            walls = np.where(direction > 0, np.add(HIGH, (self.off_m, 0, 0)), LOW)
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
            vertices, faces = mesh_shapes.fine_box(LOW, HIGH, CUTS)
            part = np.arange(len(faces)) // (2 * CUTS**2)
            return MeshShape.of(vertices, faces, part=part, free=WALLS)
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


class TestWallThatIsOff:
    """The front wall of a box is 2 cm further in than the drawing says."""

    off_m, sigma_m = -0.02, 0.003

    def _solved(self, off_m: float, seed: int = 4) -> tuple[SimulatedDome, GeometrySolution]:
        room = Room("box", off_m)
        dome = replace(_rig("box", seed, projectors=3), surface=room)
        problem = dome.problem(
            dome.observations(40, 0.05), shape=room.shape(), fiducials=self._marks(dome, room)
        )
        return dome, solve_geometry(problem)

    def _marks(self, dome: SimulatedDome, room: Room) -> list[Fiducial]:
        """Marks on the walls, measured in the planes of these."""
        rng = np.random.default_rng(5)
        angles = np.radians(rng.uniform((-180, 5), (180, 80), (12, 2)))
        point = room.intersect(np.zeros(3), direction_from_angles(*angles.T))
        high = np.add(HIGH, (room.off_m, 0, 0))
        along = ~np.isclose(point, high) & ~np.isclose(point, LOW)
        drawn = np.where(np.isclose(point, high), HIGH, point)
        stated = drawn + along * rng.normal(0, self.sigma_m, point.shape)
        angles = np.stack(angles_from_direction(normalise(stated)), axis=1)
        sigma = self.sigma_m * np.sqrt(len(dome.cameras)) / np.linalg.norm(stated, axis=1)
        return [
            Fiducial(f"mark {i}", *map(float, angles[i]), sigma[i], camera.name, pixel)
            for camera in dome.cameras
            for i, pixel in enumerate(camera_pixels(camera, point))
            if ((pixel > 0) & (pixel < 2047)).all()
        ]

    def test_it_is_found_with_its_error(self) -> None:
        dome, found = self._solved(self.off_m)
        walls = {wall.name: wall for wall in moved_walls(found.rig, found.covariance)}
        assert walls["front"].outwards_m == pytest.approx(
            self.off_m, abs=3 * walls["front"].sigma_m
        )
        assert walls["front"].most_m == pytest.approx(-self.off_m, abs=0.01)
        assert max(wall.sigma_m for wall in walls.values()) < 0.004
        for name in set(walls) - {"front"}:
            assert abs(walls[name].outwards_m) < 3 * walls[name].sigma_m
        error, sigma = dome.direction_errors(found)
        assert np.mean((error / sigma) ** 2) < 2

    def test_walls_that_are_right_stay_as_they_are_drawn(self) -> None:
        dome, found = self._solved(0.0)
        assert moved_walls(found.rig, found.covariance) == []
        error, sigma = dome.direction_errors(found)
        assert np.mean((error / sigma) ** 2) < 2
        assert np.sqrt(np.mean(error**2)) < 0.3
