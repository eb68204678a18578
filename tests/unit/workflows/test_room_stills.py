"""Test pictures on the canvas of a room."""

import numpy as np
import pytest

from procam.model.screen import RoomScreen
from procam.workflows.room_stills import GREY, INK, ROOM_STILLS, grid, ramp

SIZE = 320
BOX = RoomScreen("box", (6.0, 5.0, 3.0), ("left", "front", "right", "floor"))  # 16 m x 8 m


@pytest.mark.parametrize("name", ROOM_STILLS)
def test_each_is_light_that_a_room_can_be_asked_for(name: str) -> None:
    draw, text = ROOM_STILLS[name]
    picture = draw(SIZE, BOX)
    assert picture.shape == (SIZE // 2, SIZE, 3) and picture.dtype == np.float32
    assert 0 <= picture.min() and picture.max() <= 1 and text.endswith(".")
    assert not picture[-1, 0].any()  # below the left wall there is nothing


def test_lines_are_a_metre_apart() -> None:
    """20 pixels are a metre, and the front wall goes from 5 m to 11 m."""
    row = grid(SIZE, BOX)[30, 100:220, 1]
    np.testing.assert_allclose(row.reshape(6, 20)[:, 5:15], GREY)
    np.testing.assert_allclose(row.reshape(6, 20)[:, 0], INK)


def test_the_ramp_has_sixteen_steps_from_left_to_right() -> None:
    row = ramp(SIZE, BOX)[20, :, 1]
    np.testing.assert_allclose(row.reshape(16, 20).std(axis=1), 0, atol=1e-7)
    assert (np.diff(row[10::20]) > 0).all() and row[0] == 0 and row[-1] == 1
