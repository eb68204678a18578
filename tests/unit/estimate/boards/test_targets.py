"""Boards and tags in drawn pictures; photographs are in the tests of `lens board` and of the geometry."""

import cv2
import numpy as np
import pytest

from procam.errors import InputError
from procam.estimate.boards.targets import Board, find_board, suggest_squares
from procam.maths.codes.april_tags import find_tags, tag_cells

BOARD = Board("checkerboard", (9, 7), 0.02)
EDGE_PX = 30


def drawn() -> np.ndarray:
    rows, columns = np.indices((7 * EDGE_PX, 9 * EDGE_PX)) // EDGE_PX
    squares = np.where((rows + columns) % 2, 220, 30).astype(np.uint8)
    return cv2.GaussianBlur(np.pad(squares, 40, constant_values=220), (0, 0), 0.8)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_corners_of_a_checkerboard(kind: type) -> None:
    found = find_board(drawn().astype(kind), BOARD)
    assert found is not None
    points, pixels = found
    expected = 40 - 0.5 + EDGE_PX * (points[:, :2] / BOARD.square_m + 1)
    np.testing.assert_allclose(np.sort(pixels, axis=0), np.sort(expected, axis=0), atol=0.05)


def test_another_number_of_squares_is_suggested() -> None:
    assert find_board(drawn(), Board("checkerboard", (10, 7), 0.02)) is None
    assert suggest_squares(drawn(), (10, 7)) == (9, 7)
    assert suggest_squares(np.full((300, 300), 128, np.uint8), (9, 7)) is None


@pytest.mark.parametrize("scale", [1, 2])
def test_a_tag(scale: int) -> None:
    edge = 8 if scale == 1 else 4
    cells = np.kron(tag_cells("36h11", 17), np.ones((edge, edge))) * 255
    picture = np.pad(cells.astype(np.uint8), 5 * edge, constant_values=255)
    ((number, corners),) = find_tags(picture, "36h11", scale)
    assert number == 17
    expected = 5 * edge - 0.5 + 8 * edge * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_allclose(corners, expected, atol=1.0)
    assert find_tags(picture[:, ::-1], "36h11", scale) == []


@pytest.mark.parametrize(
    ("board", "message"),
    [
        (("checkerboard", (3, 7), 0.02), "3x7 squares of 20 mm are no board"),
        (("charuco", (9, 7), 0.02, 0.03), "markers of 30 mm do not fit"),
        (("charuco", (9, 7), 0.02, 0.01, "DICT_9"), "no marker dictionary 'DICT_9'"),
    ],
)
def test_boards_that_cannot_be(board: tuple, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Board(*board)
