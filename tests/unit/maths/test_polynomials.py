"""Smooth surfaces through scattered values."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from procam.maths.polynomials import MAX_POINTS, fit_surface

CUBIC = np.array(
    [[3.0, -0.2, 1e-3, 2e-6], [0.5, 4e-3, -1e-5, 0], [-2e-3, 3e-6, 0, 0], [1e-6, 0, 0, 0]]
)


def cubic(xy: np.ndarray) -> np.ndarray:
    """Two channels, so that a mix-up of them shows."""
    value = polynomial.polyval2d(xy[:, 0], xy[:, 1], CUBIC)
    return np.stack([value, -2 * value + 1], axis=1)


def cubic_gradient(xy: np.ndarray) -> np.ndarray:
    across = polynomial.polyval2d(*xy.T, polynomial.polyder(CUBIC, axis=0))
    down = polynomial.polyval2d(*xy.T, polynomial.polyder(CUBIC, axis=1))
    first = np.stack([across, down], axis=-1)
    return np.stack([first, -2 * first], axis=1)


@pytest.fixture
def xy(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform([-50, 300], [900, 500], (3000, 2))


class TestExact:
    @pytest.mark.parametrize("degree", [3, 4, 7])
    def test_a_polynomial_and_its_slope_come_back(self, xy: np.ndarray, degree: int) -> None:
        found = fit_surface(xy, cubic(xy), degree)
        np.testing.assert_allclose(found(xy), cubic(xy), rtol=1e-9)
        np.testing.assert_allclose(found.gradient(xy), cubic_gradient(xy), rtol=1e-7, atol=1e-7)

    def test_points_on_one_line_do_no_harm(self) -> None:
        points = np.stack([np.arange(50.0), np.full(50, 7.0)], axis=1)
        found = fit_surface(points, points[:, :1] ** 2, 2)
        np.testing.assert_allclose(found(points)[:, 0], np.arange(50.0) ** 2, atol=1e-8)


class TestRobust:
    def test_gross_errors_do_not_count(self, xy: np.ndarray, rng: np.random.Generator) -> None:
        values = cubic(xy)
        bad = rng.permutation(len(xy))[:400]
        values[bad] += rng.uniform(-500, 500, (400, 2))
        clean = np.setdiff1d(np.arange(len(xy)), bad)
        noise = rng.normal(0, 0.1, values.shape)
        found = fit_surface(xy, values + noise, 3)
        assert np.abs(found(xy) - cubic(xy)).max() < 0.05
        ideal = fit_surface(xy[clean], (values + noise)[clean], 3)
        np.testing.assert_allclose(found(xy), ideal(xy), atol=0.02)

    def test_of_very_many_points_a_part_is_enough(self, rng: np.random.Generator) -> None:
        many = rng.uniform(0, 400, (10 * MAX_POINTS, 2))
        values = cubic(many) + rng.normal(0, 1, (len(many), 2))
        found = fit_surface(many, values, 3)
        # ten coefficients of 20 000 points: sqrt(10 / 20 000) on average
        assert np.sqrt(np.mean((found(many) - cubic(many)) ** 2)) < 0.05
