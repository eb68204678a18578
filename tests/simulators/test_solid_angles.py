"""Solid angles of triangles and grids: Girard's theorem, closed forms and finer grids."""

import numpy as np
import pytest
from tolerances import CLOSED_FORM

from procam.maths.geometry.sphere import (
    cap_solid_angle,
    direction_from_angles,
    intersect_sphere,
    normalise,
)
from simulators.solid_angles import grid_solid_angles, triangle_solid_angles

FRONT, LEFT, POLE = np.eye(3)


class TestSolidAngles:
    def test_octant_and_its_orientation(self) -> None:
        assert triangle_solid_angles(FRONT, LEFT, POLE) == pytest.approx(np.pi / 2)
        assert triangle_solid_angles(LEFT, FRONT, POLE) == pytest.approx(-np.pi / 2)

    def test_triangles_against_girards_theorem(self, rng: np.random.Generator) -> None:
        a, b, c = np.moveaxis(normalise(rng.normal(size=(200, 3, 3))), 1, 0)

        def corner(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
            u, v = np.cross(p, q), np.cross(p, r)
            return np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), np.sum(u * v, axis=-1))

        expected = corner(a, b, c) + corner(b, c, a) + corner(c, a, b) - np.pi
        found = np.abs(triangle_solid_angles(a, b, c))
        np.testing.assert_allclose(found, expected, atol=1e-11)

    def test_a_tiny_triangle_keeps_its_digits(self) -> None:
        edge = 1e-6
        corners = normalise(np.array([POLE, POLE + edge * FRONT, POLE + edge * LEFT]))
        found = triangle_solid_angles(*corners)
        assert found == pytest.approx(edge**2 / 2, rel=1e-9)

    @pytest.mark.parametrize("cells", [1, 3, 16])
    def test_grid_on_a_cube_face_is_a_sixth_of_the_sphere(self, cells: int) -> None:
        x, y = np.meshgrid(*[np.linspace(-1, 1, cells + 1)] * 2)
        corners = normalise(np.stack([x, y, np.ones_like(x)], axis=-1))
        total = grid_solid_angles(corners).sum()
        assert total == pytest.approx(4 * np.pi / 6, rel=CLOSED_FORM)

    def test_polar_grid_tends_to_its_cap_in_second_order(self) -> None:
        half_angle = np.radians(70.0)

        def error(cells: int) -> float:
            theta, azimuth = np.meshgrid(
                np.linspace(1e-9, half_angle, cells + 1), np.linspace(0, 2 * np.pi, 4 * cells + 1)
            )
            corners = direction_from_angles(azimuth, np.pi / 2 - theta)
            return float(cap_solid_angle(half_angle) - grid_solid_angles(corners).sum())

        assert error(16) / error(32) == pytest.approx(4.0, rel=0.02)
        assert abs(error(256)) < 1e-4

    @pytest.mark.parametrize(("cells", "limit"), [(16, 5e-3), (64, 3e-4), (128, 8e-5)])
    def test_pixels_of_an_off_centre_device(self, cells: int, limit: float) -> None:
        """Their edges are small circles; the error against a fine subdivision falls as cells^-2."""
        fine = 4
        place = np.array([-0.8, 0.1, 0.1])
        across = np.linspace(-1.2, 1.2, cells * fine + 1)
        y, z = np.meshgrid(across, across * 0.6 + 0.3)
        rays = normalise(np.stack([np.ones_like(y), y, z], axis=-1))
        corners = intersect_sphere(place, rays, 1.0)
        coarse = grid_solid_angles(corners[::fine, ::fine])
        blocks = grid_solid_angles(corners).reshape(cells, fine, cells, fine).sum(axis=(1, 3))
        assert np.abs(coarse / blocks - 1).max() < limit

    def test_unknown_corners_give_unknown_cells_alone(self) -> None:
        x, y = np.meshgrid(np.linspace(-0.1, 0.1, 4), np.linspace(-0.1, 0.1, 4))
        corners = normalise(np.stack([x, y, np.ones_like(x)], axis=-1))
        corners[0, 0] = np.nan
        unknown = np.isnan(grid_solid_angles(corners))
        assert unknown[0, 0] and unknown.sum() == 1
