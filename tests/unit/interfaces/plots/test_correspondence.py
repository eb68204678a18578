"""The picture of a correspondence map."""

import numpy as np
import pytest

from procam.interfaces.cli.decode import HOLE, LINES, draw_map
from procam.model.correspondence import CorrespondenceMap

SIZE = (320, 200)


@pytest.fixture
def straight() -> CorrespondenceMap:
    """The panel seen at half its size, with a hole."""
    xy = np.stack(np.meshgrid(np.arange(0.5, 320, 2), np.arange(0.5, 200, 2)), -1).astype(
        np.float32
    )
    valid = np.ones(xy.shape[:2], bool)
    valid[30:40, 50:70] = False
    xy[~valid] = np.nan
    return CorrespondenceMap(xy, np.full_like(xy, 0.1), valid)


def test_holes_are_dark_grey_and_nothing_else_is(straight: CorrespondenceMap) -> None:
    picture = draw_map(straight, SIZE)
    assert (picture.shape, picture.dtype) == ((100, 160, 3), np.uint8)
    hole = (picture == HOLE).all(axis=-1)
    np.testing.assert_array_equal(hole, ~straight.valid)


def test_a_grid_of_square_cells(straight: CorrespondenceMap) -> None:
    line = (draw_map(straight, SIZE) == 255).all(axis=-1)
    cell = 320 / LINES / 2
    columns = np.flatnonzero(line[5])
    rows = np.flatnonzero(line[:, 5])
    np.testing.assert_array_equal(columns, np.arange(cell, 160, cell))
    np.testing.assert_array_equal(rows, np.arange(cell, 100, cell))


def test_red_grows_to_the_right_and_green_downwards(straight: CorrespondenceMap) -> None:
    picture = draw_map(straight, SIZE).astype(int)
    plain = straight.valid & ~(picture == 255).all(axis=-1)
    x, y = straight.projector_xy[plain].T
    red, green, blue = picture[plain].T
    np.testing.assert_allclose(red, 255 * (0.15 + 0.7 * x / 319), atol=0.51)
    np.testing.assert_allclose(green, 255 * (0.15 + 0.7 * y / 199), atol=0.51)
    np.testing.assert_allclose(blue, 255 * (0.85 - 0.35 * (x / 319 + y / 199)), atol=0.51)


def test_a_fault_shows(straight: CorrespondenceMap) -> None:
    """A pixel on another fringe has another colour and lines around it."""
    before = draw_map(straight, SIZE).astype(int)
    straight.projector_xy[15, 26] += 60
    after = draw_map(straight, SIZE).astype(int)
    changed = np.argwhere((after != before).any(axis=-1)).tolist()
    assert [15, 26] in changed and 1 <= len(changed) <= 3


def test_places_beyond_the_panel_stay_in_range() -> None:
    xy = np.array([[[-40.0, 500.0], [900.0, -3.0]]], np.float32)
    picture = draw_map(CorrespondenceMap(xy, 0 * xy, np.ones((1, 2), bool)), SIZE)
    assert picture[0, 0].tolist() == pytest.approx([38, 217, 128], abs=1)


def test_a_map_of_nothing() -> None:
    xy = np.full((4, 5, 2), np.nan, np.float32)
    assert (draw_map(CorrespondenceMap(xy, xy, np.zeros((4, 5), bool)), SIZE) == HOLE).all()
