"""Fits of rotations, smooth fields and motions to differences of directions."""

import numpy as np
import pytest

from procam.estimate.comparison.common_pixels import (
    CommonPixels,
    own_motion,
    rms_arcmin,
    smooth_field,
    turn_between,
)
from procam.maths.geometry.pose import rotation_matrix
from procam.maths.geometry.sphere import intersect_sphere, normalise

COUNT = 500
SIGMA = 1e-4


def _directions(rng: np.random.Generator) -> np.ndarray:
    return normalise(rng.normal(size=(COUNT, 3)) * 0.3 + [0.5, 0, 1.0])


def _pair(first: np.ndarray, second: np.ndarray, place: np.ndarray | None = None) -> CommonPixels:
    area, variance = np.ones(COUNT, np.float32), np.full(COUNT, 2 * SIGMA**2, np.float32)
    place = np.zeros(3) if place is None else place
    return CommonPixels(first, second, variance, area, area, 0.0, place)


def test_a_rotation_is_recovered_and_a_smooth_field(rng: np.random.Generator) -> None:
    first, turn = _directions(rng), rotation_matrix([0.01, -0.02, 0.03])
    pair = _pair(first, first @ turn)
    np.testing.assert_allclose(turn_between([pair]), turn, atol=1e-12)
    step = pair.step(np.eye(3))
    small = np.cross([1e-5, 2e-5, -1e-5], first)
    np.testing.assert_allclose(smooth_field(first, small, pair.variance), small, atol=1e-12)
    assert rms_arcmin(step) == pytest.approx(60 * np.degrees(np.sqrt(np.mean(np.sum(step**2, 1)))))


def test_a_motion_of_the_projector_is_explained(rng: np.random.Generator) -> None:
    first, place = _directions(rng), np.array([-0.4, 0.3, 0.1])
    rays = normalise(first - place) @ rotation_matrix([1e-5, -2e-5, 1e-5]).T
    second = intersect_sphere(place + np.array([2e-5, 0, -1e-5]), rays, 1.0)
    pair = _pair(first, second, place)
    step = pair.step(np.eye(3))
    residual = step - own_motion(pair, step)
    assert np.abs(residual).max() < 1e-3 * np.abs(step).max()


def test_thinning_keeps_pixels_together_and_spreads_them(rng: np.random.Generator) -> None:
    first = _directions(rng)
    thin = _pair(first, 2 * first).thinned(50)
    assert thin.first.shape == (50, 3) and len(thin.variance) == 50
    np.testing.assert_array_equal(thin.second, 2 * thin.first)
