"""Points where rays meet a dome that is nearly a sphere: on it, with the right gradients."""

import numpy as np
import pytest

from procam.kernels.bundle.reference import on_screen
from procam.maths.geometry.ray_to_screen import RoundShape, shape_coefficient_count

RADIUS_M = 6.0
COUNT = 400


def _shape(size: float, degree: int = 4) -> RoundShape:
    rng = np.random.default_rng(9)
    return RoundShape(RADIUS_M, rng.normal(0, size, shape_coefficient_count(degree)), degree)


def _rays(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(COUNT, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return rng.normal(0, 0.8, (COUNT, 3)), direction


def _height(shape: RoundShape, point: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(point, axis=1)
    return distance - shape.radius_at(point / distance[:, None])


def test_an_exact_sphere_has_no_derivatives() -> None:
    origin, direction = _rays()
    shape = RoundShape(RADIUS_M)
    assert shape.shape_derivatives(origin, direction) is None
    hit = shape.hit(origin, direction)
    np.testing.assert_allclose(np.linalg.norm(hit.point, axis=1), RADIUS_M, rtol=1e-14)
    np.testing.assert_allclose(hit.outward, hit.point / RADIUS_M, rtol=1e-14)
    assert hit.values.shape == (COUNT, 0)


def test_points_lie_on_the_surface_and_on_their_rays() -> None:
    """A centimetre on 6 m: linear extrapolation is good to 1e-7 of the radius."""
    shape, (origin, direction) = _shape(3e-4), _rays()
    point = shape.intersect(origin, direction)
    assert np.abs(_height(shape, point)).max() < 1e-7 * RADIUS_M
    along = np.sum((point - origin) * direction, axis=1)
    np.testing.assert_allclose(point, origin + along[:, None] * direction, atol=1e-12)
    assert (along > 0).all()


@pytest.mark.parametrize(("off", "limit"), [(1e-3, 1e-7), (1e-2, 1e-5)])
def test_derivatives_serve_rays_that_moved(off: float, limit: float) -> None:
    """Its error grows with the square of how far off it was taken, and with the coefficients."""
    shape, (origin, direction) = _shape(1e-4), _rays()
    derivatives = shape.shape_derivatives(origin, direction)
    step = np.random.default_rng(3).normal(0, off, direction.shape)
    moved = (direction + step) / np.linalg.norm(direction + step, axis=1, keepdims=True)
    point = on_screen(origin, moved, RADIUS_M, shape.harmonic_coefficients, derivatives).point
    assert np.abs(_height(shape, point)).max() < limit * RADIUS_M


def test_derivatives_serve_other_coefficients_and_another_radius() -> None:
    origin, direction = _rays()
    derivatives = _shape(0.0).shape_derivatives(origin, direction)
    other = RoundShape(RADIUS_M * 1.002, _shape(1e-4).harmonic_coefficients, 4)
    coefficients = other.harmonic_coefficients
    point = on_screen(origin, direction, other.radius_m, coefficients, derivatives).point
    assert np.abs(_height(other, point)).max() < 1e-7 * RADIUS_M


def test_outward_is_the_gradient_of_the_height() -> None:
    shape, (origin, direction) = _shape(1e-3), _rays()
    hit = shape.hit(origin, direction)
    for i in range(3):
        step = 1e-6 * np.eye(3)[i]
        slope = (_height(shape, hit.point + step) - _height(shape, hit.point - step)) / 2e-6
        np.testing.assert_allclose(
            hit.outward[:, i], slope, atol=1e-3 * 0.3
        )  # tangents: 1e-3^2 l^3
    values, _ = shape.harmonics_at(hit.point / np.linalg.norm(hit.point, axis=1, keepdims=True))
    np.testing.assert_allclose(hit.values, values, atol=1e-3)


def test_rays_that_miss_are_unknown() -> None:
    shape = _shape(1e-4)
    point = shape.intersect(np.array([[9.0, 0, 0], [0, 0, 0]]), np.array([[0.0, 1, 0], [0, 1, 0]]))
    np.testing.assert_array_equal(np.isnan(point).all(axis=1), [True, False])
