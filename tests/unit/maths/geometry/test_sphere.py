"""Directions, dome masters and solid angles against closed forms and quadrature."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import CLOSED_FORM, SOLVER

from procam.maths.geometry.sphere import (
    angle_between,
    angles_from_direction,
    cap_solid_angle,
    direction_from_angles,
    intersect_sphere,
    master_directions,
    master_pixels,
    master_planes,
    master_solid_angles,
)
from simulators.solid_angles import grid_solid_angles

FRONT, LEFT, POLE = np.eye(3)


class TestAngles:
    @given(azimuth=st.floats(-3.14, 3.14), elevation=st.floats(-1.57, 1.57))
    def test_round_trip(self, azimuth: float, elevation: float) -> None:
        direction = direction_from_angles(azimuth, elevation)
        back = angles_from_direction(direction)
        assert back[1] == pytest.approx(elevation, abs=CLOSED_FORM)
        turned = (back[0] - azimuth) * np.cos(elevation)
        assert turned == pytest.approx(0, abs=CLOSED_FORM)

    def test_front_left_and_pole(self) -> None:
        found = direction_from_angles([0, np.pi / 2, 0], [0, 0, np.pi / 2])
        np.testing.assert_allclose(found, [FRONT, LEFT, POLE], atol=CLOSED_FORM)

    @pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.5, np.pi / 2, np.pi])
    def test_angle_between_keeps_tiny_angles(self, angle: float) -> None:
        turned = np.array([np.cos(angle), np.sin(angle), 0.0])
        assert angle_between(FRONT, turned) == pytest.approx(angle, rel=1e-9)


class TestDomeMaster:
    @pytest.mark.parametrize("size", [8, 9, 4096])
    def test_front_is_at_the_bottom_edge_and_left_at_the_left(self, size: int) -> None:
        centre = (size - 1) / 2
        places = master_pixels(np.stack([FRONT, LEFT, POLE, -FRONT, -LEFT]), size)
        expected = [
            [centre, size - 0.5],
            [-0.5, centre],
            [centre, centre],
            [centre, -0.5],
            [size - 0.5, centre],
        ]
        np.testing.assert_allclose(places, expected, atol=SOLVER)

    @pytest.mark.parametrize(("size", "fov_deg"), [(7, 180.0), (10, 180.0), (10, 210.0)])
    def test_pixel_by_pixel_as_the_definition_says(self, size: int, fov_deg: float) -> None:
        fov = np.radians(fov_deg)
        directions, inside = master_directions(size, fov)
        c = (size - 1) / 2
        for row in range(size):
            for col in range(size):
                dx, dy = (col - c) / (size / 2), (row - c) / (size / 2)
                q = np.hypot(dx, dy)
                theta = q * fov / 2
                expected = (
                    [np.sin(theta) * dy / q, -np.sin(theta) * dx / q, np.cos(theta)] if q else POLE
                )
                np.testing.assert_allclose(directions[row, col], expected, atol=CLOSED_FORM)
                assert inside[row, col] == (q <= 1)

    @given(size=st.integers(2, 40), fov=st.floats(0.5, 3.8))
    def test_round_trip(self, size: int, fov: float) -> None:
        directions, inside = master_directions(size, fov)
        places = master_pixels(directions, size, fov)
        grid = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1)
        np.testing.assert_allclose(places[inside], grid[inside], atol=SOLVER)

    @pytest.mark.parametrize("fov_deg", [90.0, 180.0, 220.0])
    def test_solid_angles_sum_to_the_cap(self, fov_deg: float) -> None:
        fov, size = np.radians(fov_deg), 1024
        total = master_solid_angles(size, fov).sum()
        # pixels on the circle are in or out as a whole: Gauss's circle problem, about N^(-3/2)
        assert total == pytest.approx(cap_solid_angle(fov / 2), rel=1e-4)

    def test_solid_angle_of_each_pixel_is_that_of_its_outline(self) -> None:
        size = 64
        offset = (np.arange(size + 1) - 0.5 - (size - 1) / 2) / (size / 2)
        dx, dy = np.meshgrid(offset, offset)
        theta, azimuth = np.hypot(dx, dy) * np.pi / 2, np.arctan2(-dx, dy)
        corners = direction_from_angles(azimuth, np.pi / 2 - theta)
        inner = np.hypot(*np.meshgrid(*[np.arange(size) - (size - 1) / 2] * 2)) < size / 2 - 1
        outline = grid_solid_angles(corners)
        error = master_solid_angles(size)[inner] / outline[inner] - 1
        assert np.abs(error).max() < 1.2 / size**2 * np.pi**2 / 4  # second order in the pixel

    @pytest.mark.parametrize("size", [2, 33, 256])
    def test_planes_are_the_same_in_single_precision(self, size: int) -> None:
        direction, area = master_planes(size)
        assert direction.dtype == area.dtype == np.float32
        expected, inside = master_directions(size)
        np.testing.assert_allclose(np.moveaxis(direction, 0, -1), expected, atol=3e-7)
        np.testing.assert_allclose(area, master_solid_angles(size), rtol=1e-6)
        np.testing.assert_array_equal(area > 0, inside)


class TestSolidAngles:
    @pytest.mark.parametrize("half_angle", [1e-3, 0.5, np.pi / 2, 2.5, np.pi])
    def test_cap_against_quadrature(self, half_angle: float) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(30)
        theta = half_angle * (nodes + 1) / 2
        integral = 2 * np.pi * half_angle / 2 * weights @ np.sin(theta)
        assert cap_solid_angle(half_angle) == pytest.approx(integral, rel=1e-9)


class TestIntersectSphere:
    @given(
        origin=st.tuples(*[st.floats(-0.55, 0.55)] * 3).map(np.array),
        azimuth=st.floats(-3.14, 3.14),
        elevation=st.floats(-1.57, 1.57),
    )
    def test_meets_the_sphere_ahead(
        self, origin: np.ndarray, azimuth: float, elevation: float
    ) -> None:
        ray = direction_from_angles(azimuth, elevation)
        point = intersect_sphere(6 * origin, ray, 6.0)
        assert np.linalg.norm(point) == pytest.approx(6, abs=SOLVER)
        assert (point - 6 * origin) @ ray > 0
        assert np.linalg.norm(np.cross(point - 6 * origin, ray)) == pytest.approx(0, abs=SOLVER)

    def test_a_device_on_the_sphere_sees_across(self) -> None:
        np.testing.assert_allclose(
            intersect_sphere(np.array([-6.0, 0, 0]), FRONT, 6.0), 6 * FRONT, atol=SOLVER
        )

    def test_a_miss_is_unknown(self) -> None:
        assert np.isnan(intersect_sphere(np.array([-20.0, 7.0, 0]), FRONT, 6.0)).all()

    def test_one_radius_per_ray(self) -> None:
        points = intersect_sphere(np.zeros(3), np.stack([FRONT, POLE]), np.array([2.0, 3.0]))
        np.testing.assert_allclose(points, [2 * FRONT, 3 * POLE], atol=CLOSED_FORM)
