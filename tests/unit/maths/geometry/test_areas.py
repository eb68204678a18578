"""Sizes of pixels: quadrature of the true pixel, caps, and flat and round surfaces."""

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from procam.maths.geometry.areas import BLOCK, panel_solid_angles
from procam.maths.geometry.lenses import Lens, unproject
from procam.maths.geometry.sphere import (
    direction_from_angles,
    intersect_sphere,
    normalise,
)
from simulators.solid_angles import grid_solid_angles

RADIUS_M = 6.0
PLACE = np.array([-3.0, 2.0, 0.3])
SIZE = (480, 300)


def rotation() -> np.ndarray:
    """Columns: right, down and ahead of the projector."""
    ahead = normalise(np.array([0.7, -0.3, 0.6]))
    right = normalise(np.cross(ahead, [0.0, 0.0, 1.0]))
    return np.stack([right, np.cross(ahead, right), ahead], axis=1)


def lens(size: tuple[int, int]) -> Lens:
    focal = 0.62 * size[0]
    return Lens("brown", np.array([focal, focal]), (np.array(size) - 1) / 2, np.zeros(5))


def points_at(size: tuple[int, int], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    return intersect_sphere(PLACE, unproject(pixels, lens(size)) @ rotation().T, RADIUS_M)


def quadrature(size: tuple[int, int], nodes: int = 4) -> np.ndarray:
    """Solid angle (H, W) from the centre of each true pixel, without corners or edges.

    That from the projector, dx dy / (f^2 (1 + r^2)^(3/2)), times distance^2 / (R^2 cosine of
    incidence), by Gauss and Legendre.
    """
    at, weight = leggauss(nodes)
    width, height = size
    focal = lens(size).focal[0]
    total = np.zeros((height, width))
    for dx, wx in zip(at / 2, weight / 2, strict=True):
        for dy, wy in zip(at / 2, weight / 2, strict=True):
            x, y = np.arange(width) + dx, np.arange(height) + dy
            rays = unproject(np.stack(np.meshgrid(x, y), axis=-1), lens(size))
            point = points_at(size, x, y)
            away = np.linalg.norm(point - PLACE, axis=-1)
            incidence = np.sum((point - PLACE) * point, axis=-1) / (away * RADIUS_M)
            total += wx * wy * rays[..., 2] ** 3 / focal**2 * away**2 / (RADIUS_M**2 * incidence)
    return total


class TestSolidAngles:
    def test_of_every_pixel_are_those_of_the_quadrature(self) -> None:
        found = panel_solid_angles(SIZE, lambda x, y: normalise(points_at(SIZE, x, y)))
        truth = quadrature(SIZE)
        np.testing.assert_allclose(truth, quadrature(SIZE, 6), rtol=1e-10)
        assert np.abs(found / truth - 1).max() < 1e-5
        assert found.sum() == pytest.approx(truth.sum(), rel=1e-6)

    def test_corners_are_asked_for_a_few_rows_at_a_time(self) -> None:
        asked = []

        def directions(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            asked.append((len(x), len(y)))
            return normalise(points_at((1000, 300), x, y))

        found = panel_solid_angles((1000, 300), directions)
        assert all(nx == 1001 and nx * ny <= BLOCK for nx, ny in asked)
        assert sum(ny for _, ny in asked) == 301
        x, y = np.arange(1001) - 0.5, np.arange(301) - 0.5
        whole = grid_solid_angles(normalise(points_at((1000, 300), x, y)))
        np.testing.assert_allclose(found, whole, rtol=1e-12)

    def test_a_panel_wider_than_a_block(self) -> None:
        def directions(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            return direction_from_angles(*np.meshgrid(x * 1e-5, y * 0.1))

        assert panel_solid_angles((BLOCK + 3, 2), directions).shape == (2, BLOCK + 3)
