"""Real spherical harmonics against scipy's, and their slopes against differences."""

import numpy as np
from scipy.special import sph_harm_y

from procam.maths.geometry.harmonics import harmonic_count, harmonics


def _directions(count: int) -> np.ndarray:
    points = np.random.default_rng(5).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_equal_scipys() -> None:
    direction = _directions(50)
    polar, azimuth = np.arccos(direction[:, 2]), np.arctan2(direction[:, 1], direction[:, 0])
    expected = []
    for degree in range(1, 9):
        for order in range(degree + 1):
            wave = np.sqrt(4 * np.pi) * (-1) ** order * sph_harm_y(degree, order, polar, azimuth)
            expected += (
                [wave.real] if order == 0 else [np.sqrt(2) * wave.real, np.sqrt(2) * wave.imag]
            )
    values, _ = harmonics(direction, 1, 8)
    np.testing.assert_allclose(values, np.stack(expected, axis=1), atol=1e-10)


def test_mean_square_is_one_and_they_are_orthogonal() -> None:
    z, weight = np.polynomial.legendre.leggauss(12)
    azimuth = np.arange(24) * 2 * np.pi / 24
    z, azimuth = (a.ravel() for a in np.meshgrid(z, azimuth))
    weight = np.tile(weight, 24) / 48
    wide = np.sqrt(1 - z * z)
    values, _ = harmonics(np.stack([wide * np.cos(azimuth), wide * np.sin(azimuth), z], 1), 0, 5)
    np.testing.assert_allclose(values.T @ (weight[:, None] * values), np.eye(36), atol=1e-12)


def test_slopes() -> None:
    direction = _directions(40)
    _, slopes = harmonics(direction, 2, 6)
    assert slopes.shape == (40, harmonic_count(2, 6), 3)
    rng = np.random.default_rng(6)
    step = rng.normal(size=(40, 3)) * 1e-6
    step -= np.sum(step * direction, axis=1, keepdims=True) * direction
    ahead, behind = direction + step, direction - step
    ahead, behind = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (ahead, behind))
    change = harmonics(ahead, 2, 6)[0] - harmonics(behind, 2, 6)[0]
    np.testing.assert_allclose(np.einsum("nki,ni->nk", slopes, 2 * step), change, atol=1e-11)
    np.testing.assert_allclose(np.einsum("nki,ni->nk", slopes, direction), 0, atol=1e-12)
