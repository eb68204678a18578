"""The matched white is the largest that everybody can show and nobody sees fall off."""

import numpy as np
import pytest

from procam.estimate.light.luminance_matching import CELLS, matched_white
from procam.maths.geometry.sphere import angle_between, master_directions, master_pixels
from procam.maths.warp import sample

SIZE = 2 * CELLS
SLOPE = 0.5  # per radian


@pytest.fixture(scope="module")
def direction() -> np.ndarray:
    return master_directions(SIZE)[0]


def white(direction: np.ndarray) -> np.ndarray:
    """Bright to the front, with a dim spot."""
    light = 1.5 + direction[..., 0]
    light = np.where(direction @ [0.6, 0.0, 0.8] > 0.995, 0.8, light)
    return light[..., None] * [1.0, 0.9, 1.1]


def lit(direction: np.ndarray) -> np.ndarray:
    return master_directions(SIZE)[1] & (direction[..., 2] > 0.1)


def test_an_even_white_is_even(direction: np.ndarray) -> None:
    assert (matched_white(white(direction), lit(direction), 0.0) == 1).all()


def test_nobody_is_asked_for_more_than_he_has(direction: np.ndarray) -> None:
    hi, on = white(direction), lit(direction)
    shape = matched_white(hi, on, SLOPE)
    level = (hi[on].min(axis=1) / shape[on]).min()
    even = hi[on].min()
    assert level > 1.1 * even  # what the matching gains at its brightest
    assert shape[on].max() == pytest.approx(1, abs=0.01)


def test_the_falloff_keeps_its_limit(direction: np.ndarray) -> None:
    on = lit(direction)
    height = np.log(matched_white(white(direction), on, SLOPE))
    for axis in (0, 1):
        a, b = (np.take(direction, r, axis) for r in (range(SIZE - 4), range(4, SIZE)))
        both = np.take(on, range(SIZE - 4), axis) & np.take(on, range(4, SIZE), axis)
        far = np.take(height, range(4, SIZE), axis) - np.take(height, range(SIZE - 4), axis)
        steep = np.abs(far)[both] / angle_between(a, b)[both]
        assert steep.max() < 1.05 * SLOPE


def test_round_a_dim_spot_it_is_a_cone(direction: np.ndarray) -> None:
    """One dim place in an even white: log w = min(even, spot + slope * angle)."""
    spot = np.array([0.0, 0.0, 1.0])
    angle = np.arccos(np.clip(direction @ spot, -1, 1))
    hi = np.where(angle < 0.05, 0.7, 1.0)[..., None] * np.ones(3)
    shape = matched_white(hi, lit(direction), SLOPE)
    expected = np.minimum(1, 0.7 * np.exp(SLOPE * (angle - 0.05)))
    inside = lit(direction)
    np.testing.assert_allclose(shape[inside], expected[inside], rtol=0.03)


@pytest.mark.parametrize("size", [CELLS // 2, 3 * CELLS // 2])
def test_a_dome_master_that_the_cells_do_not_divide(size: int) -> None:
    coarse, fine = (master_directions(n)[0] for n in (size, SIZE))
    on, fine_on = coarse[..., 2] > 0.1, fine[..., 2] > 0.1
    shape = matched_white(white(coarse), on, SLOPE)
    expected = sample(matched_white(white(fine), fine_on, SLOPE), master_pixels(coarse, SIZE))
    np.testing.assert_allclose(shape[on], expected[on], rtol=0.05)


def test_nothing_lit(direction: np.ndarray) -> None:
    nothing = np.zeros((SIZE, SIZE), bool)
    assert (matched_white(white(direction), nothing, SLOPE) == 1).all()
