"""Rays against meshes: closed forms of boxes, prisms and spheres."""

import sys

import numpy as np
import pytest
from mesh_shapes import box, cylinder, hemisphere, scattered_sphere

from procam.errors import InputError
from procam.maths.geometry.sphere import angle_between, intersect_sphere, normalise
from procam.maths.mesh.raycast import BEHIND, BLOCK, MeshTracer
from simulators.solid_angles import grid_solid_angles

EXACT_M = 1e-9
LOW, HIGH = (-3.0, -2.0, -1.0), (4.0, 5.0, 3.5)


def box_exit(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Where rays from inside leave the box: the nearest of the three planes ahead."""
    with np.errstate(divide="ignore"):
        ahead = (np.where(direction > 0, HIGH, LOW) - origin) / direction
    return origin + ahead.min(axis=-1, keepdims=True) * direction


def prism_exit(origin: np.ndarray, direction: np.ndarray, radius: float, sides: int) -> np.ndarray:
    """Where rays from inside meet the walls of a regular prism round z."""
    angle = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    apothem = radius * np.cos(np.pi / sides)
    speed = direction @ outward.T
    ahead = np.where(
        speed > 0, (apothem - origin @ outward.T) / np.where(speed > 0, speed, 1), np.inf
    )
    return origin + ahead.min(axis=-1, keepdims=True) * direction


def panel(width: int = 480, height: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Corner rays (H + 1, W + 1, 3) of an off-centre projector in a dome of 8 m, and its place."""
    ahead = normalise(np.array([-0.5, 0.4, 0.6]))
    right = normalise(np.cross(ahead, [0.0, 0.0, 1.0]))
    x, y = np.linspace(-0.9, 0.9, width + 1), np.linspace(0.6, -0.6, height + 1)
    rays = ahead + x[:, None] * right + y[:, None, None] * np.cross(right, ahead)
    return normalise(rays), np.array([3.0, -4.0, 0.5])


class TestFlatFaces:
    @pytest.mark.parametrize("smooth", [False, True])
    def test_points_on_a_box(self, smooth: bool, rng: np.random.Generator) -> None:
        tracer = MeshTracer(*box(LOW, HIGH), smooth=smooth)
        origin = rng.uniform(np.array(LOW) + 0.1, np.array(HIGH) - 0.1, (20_000, 3))
        direction = normalise(rng.normal(0, 1, (20_000, 3)))
        hits = tracer.first_hits(origin, direction)
        expected = box_exit(origin, direction)
        assert np.abs(hits.points - expected).max() < EXACT_M
        wall = np.isclose(expected, LOW, atol=1e-9) * 1.0 - np.isclose(expected, HIGH, atol=1e-9)
        np.testing.assert_allclose(hits.normals, wall, atol=1e-12)

    def test_no_ray_passes_edges_and_corners(self, rng: np.random.Generator) -> None:
        """Embree rounds to 1e-7 and may return the wrong wall; every ray still gets its exact point."""
        tracer = MeshTracer(*box(LOW, HIGH))
        target = rng.uniform(LOW, HIGH, (3000, 3))
        for axis in range(3):
            others = [a for a in range(3) if a != axis]
            third = slice(axis * 1000, (axis + 1) * 1000)
            ends = rng.integers(0, 2, (1000, 2)) == 1
            target[third, others] = np.where(ends, np.array(HIGH)[others], np.array(LOW)[others])
        target = np.concatenate([target, box(LOW, HIGH)[0]])
        target = target + rng.normal(0, 1e-8, target.shape)
        origin = np.array([0.3, 0.2, 0.1])
        hits = tracer.first_hits(origin, target - origin)
        expected = box_exit(origin, target - origin)
        assert np.abs(hits.points - expected).max() < 2e-8

    @pytest.mark.parametrize("sides", [3, 64])
    def test_points_on_a_prism(self, sides: int, rng: np.random.Generator) -> None:
        tracer = MeshTracer(*cylinder(5.0, 4.0, sides))
        origin = rng.uniform([-1, -1, 1], [1, 1, 3], (10_000, 3))
        direction = normalise(rng.normal(0, 1, (10_000, 3)))
        expected = prism_exit(origin, direction, 5.0, sides)
        inside = (expected[:, 2] > 1e-6) & (expected[:, 2] < 4 - 1e-6)
        outside = (expected[:, 2] < -1e-6) | (expected[:, 2] > 4 + 1e-6)
        hits = tracer.first_hits(origin, direction)
        assert np.abs(hits.points - expected)[inside].max() < EXACT_M
        assert np.isnan(hits.points[outside]).all()
        assert np.isnan(hits.normals[outside]).all()
        assert ((hits.faces == -1) == np.isnan(hits.points[:, 0])).all()


class TestSmooth:
    def test_a_hemisphere_of_100_000_triangles_is_a_dome(self) -> None:
        """Directions within 1e-5 rad rms, areas within 1e-4 (median), from off-centre."""
        vertices, faces = hemisphere(8.0, 158)
        assert len(faces) == pytest.approx(100_000, rel=0.01)
        rays, place = panel()
        points = MeshTracer(vertices, faces, smooth=True).intersect(place, rays)
        truth = intersect_sphere(place, rays, 8.0)
        seen = truth[..., 2] > 1e-3
        assert not np.isnan(points[seen]).any()
        apart = angle_between(normalise(points), normalise(truth))[seen]
        assert np.sqrt(np.mean(apart**2)) < 1e-8  # asked: 1e-5
        expected = grid_solid_angles(normalise(truth))
        error = np.abs(grid_solid_angles(normalise(points)) / expected - 1)
        assert np.nanmedian(error) < 1e-6  # asked: 1e-4
        assert np.nanmax(error) < 1e-5

    def test_normals_turn_with_the_surface(self, rng: np.random.Generator) -> None:
        tracer = MeshTracer(*scattered_sphere(6.0, 20_000), smooth=True)
        hits = tracer.first_hits(np.array([1.0, 2, 3]), normalise(rng.normal(0, 1, (5000, 3))))
        assert np.abs(hits.normals + hits.points / 6.0).max() < 1e-4

    def test_a_cylinder_is_round(self, rng: np.random.Generator) -> None:
        tracer = MeshTracer(*cylinder(5.0, 4.0, 720, closed=True), smooth=True)
        origin = rng.uniform([-1, -1, 1], [1, 1, 3], (5000, 3))
        direction = normalise(rng.normal(0, 1, (5000, 3)))
        hits = tracer.first_hits(origin, direction)
        wall = np.abs(hits.normals[:, 2]) < 0.5
        assert np.abs(np.hypot(*hits.points[wall, :2].T) - 5.0).max() < EXACT_M
        np.testing.assert_allclose(
            np.abs(hits.points[~wall, 2] - 2), 2.0, atol=EXACT_M
        )  # floor and ceiling stay flat

    def test_a_ray_that_grazes_keeps_its_flat_point(self) -> None:
        """From the rim's height a ray almost along a coarse facet: the point is still on the mesh."""
        vertices, faces = hemisphere(5.0, 4)
        tracer = MeshTracer(vertices, faces, smooth=True)
        x = np.linspace(-1, 1, 41)
        rays = normalise(np.stack([np.ones(41), x, np.full(41, 1e-3)], axis=1))
        points = tracer.intersect(np.array([4.3, 0.0, 0.01]), rays)
        assert (np.linalg.norm(points, axis=1) < 5.1).all()


class TestRays:
    def test_any_shape_any_length_any_block(self, rng: np.random.Generator) -> None:
        tracer = MeshTracer(*box(LOW, HIGH))
        direction = normalise(rng.normal(0, 1, (3, BLOCK // 2 + 5, 3)))
        found = tracer.first_hits(np.zeros(3), 7 * direction)
        assert found.points.shape == direction.shape
        assert found.faces.shape == direction.shape[:-1]
        assert np.abs(found.points - box_exit(np.zeros(3), direction)).max() < EXACT_M
        one = tracer.first_hits(np.zeros(3), direction[1, 2])
        np.testing.assert_allclose(one.points, found.points[1, 2], atol=1e-12)
        assert tracer.intersect(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 3)

    def test_nan_rays_miss(self) -> None:
        hits = MeshTracer(*box(LOW, HIGH)).first_hits(
            np.zeros(3), np.array([[np.nan, 0, 1], [1, 0, 0]])
        )
        assert hits.faces[0] == -1
        assert np.isnan(hits.points[0]).all()
        assert hits.faces[1] >= 0

    def test_the_outside_is_not_met(self) -> None:
        tracer = MeshTracer(*cylinder(5.0, 4.0, 64))
        hits = tracer.first_hits(np.array([-14.0, 0, 2]), np.array([1.0, 0.1, 0]))
        assert hits.faces == -1

    @pytest.mark.parametrize("step", [0.0, 1e-6, 0.1 * BEHIND, -1e-6])
    def test_a_device_may_stand_on_the_screen(self, step: float, rng: np.random.Generator) -> None:
        """On it or behind a hole in it: rays meet the far side, as on a sphere."""
        tracer = MeshTracer(*box(LOW, HIGH))
        origin = np.array([-3.0 - step * 7, 1.0, 1.0])
        direction = normalise(rng.normal([1, 0, 0], 0.4, (200, 3)))
        direction = direction[direction[:, 0] > 0.2]
        expected = box_exit(origin, direction)
        assert np.abs(tracer.intersect(origin, direction) - expected).max() < EXACT_M


def test_a_missing_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(InputError, match=r'needs embreex, .* Run: pip install "procam\[geom\]"'):
        MeshTracer(*box(LOW, HIGH))
