"""Form factors between polygons against closed forms."""

import numpy as np
import pytest

from procam.maths.mesh.contours import exchange_areas

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def _facing(height: float) -> np.ndarray:
    return SQUARE[::-1] + np.array([0, 0, height])


def _disc(radius: float, corners: int = 720) -> np.ndarray:
    """A regular polygon of a disc's area."""
    angle = np.arange(corners) * 2 * np.pi / corners
    edge = radius * np.sqrt(np.pi / (corners / 2 * np.sin(2 * np.pi / corners)))
    return edge * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


def _between(first: np.ndarray, second: np.ndarray) -> float:
    return float(exchange_areas(first[None], second[None])[0])


def test_unit_squares_that_face_each_other() -> None:
    assert _between(SQUARE, _facing(1.0)) == pytest.approx(0.199824896, abs=1e-8)


def test_unit_squares_that_share_an_edge() -> None:
    wall = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    assert _between(SQUARE, wall) == pytest.approx(0.200043776, abs=1e-8)


def test_discs() -> None:
    """Radius and distance 1: (3 - sqrt(5)) / 2."""
    disc = _disc(1.0)
    found = _between(disc, disc[::-1] + np.array([0, 0, 1.0])) / np.pi
    assert found == pytest.approx(0.381966011, abs=1e-6)


@pytest.mark.parametrize("height", [0.3, 4.0])
def test_parts_add_up(height: float) -> None:
    """A square in two triangles; they share a corner with nothing of the other."""
    above = _facing(height)
    parts = [above[[0, 1, 2]], above[[0, 2, 3]]]
    assert sum(_between(SQUARE, part) for part in parts) == pytest.approx(
        _between(SQUARE, above), rel=1e-6
    )


def test_triangles_of_a_corner_add_up() -> None:
    """Pairs that share an edge, a corner or nothing: together the squares that share an edge."""
    wall = np.array([[0.0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    total = sum(
        _between(SQUARE[list(a)], wall[list(b)])
        for a in ((0, 1, 2), (0, 2, 3))
        for b in ((0, 1, 2), (0, 2, 3))
    )
    assert total == pytest.approx(0.200043776, abs=1e-7)


def test_far_apart_it_is_the_kernel() -> None:
    assert _between(SQUARE, _facing(50.0)) == pytest.approx(1 / (np.pi * 50.0**2), rel=1e-3)
