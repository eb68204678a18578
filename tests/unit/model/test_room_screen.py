"""Rooms as screens: their canvas, and what lies in which direction."""

import numpy as np
import pytest

from procam.model.screen import RoomScreen

BOX = RoomScreen(
    "box",
    (6.0, 5.0, 3.0),
    ("left", "front", "right", "floor"),
    (("back", 0.2, 0.1), ("ceiling", 0.7, 0.05)),
)
CYLINDER = RoomScreen("cylinder", (5.0, 120.0, 3.0), ("wall",), (("floor", 0.3, 0.1),))
SCREENS = pytest.mark.parametrize("screen", [BOX, CYLINDER], ids=["box", "cylinder"])
SIZE = 160


@SCREENS
def test_pixels_of_directions_are_those_of_the_canvas(screen: RoomScreen) -> None:
    direction, lit = screen.canvas.directions(SIZE)
    rows, columns = screen.canvas.shape(SIZE)
    assert lit.shape == (rows, columns)
    y, x = np.indices(lit.shape)
    found = screen.canvas.pixels(direction, SIZE)
    np.testing.assert_allclose(found[lit], np.stack([x, y], axis=-1)[lit], atol=1e-3)


@SCREENS
def test_areas_are_those_of_the_lit_parts(screen: RoomScreen) -> None:
    area = {"box": 2 * 15 + 18 + 30, "cylinder": 5 * np.radians(120) * 3}[screen.kind]
    assert screen.canvas.weights(SIZE).sum() == pytest.approx(area, rel=0.01)


def test_a_cylinder_is_round() -> None:
    direction, lit = CYLINDER.canvas.directions(SIZE)
    points = CYLINDER.shape.radius_at(direction[lit])[:, None] * direction[lit]
    np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 5.0, atol=1e-4)


def test_what_is_not_on_the_canvas_has_no_pixel() -> None:
    behind = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # back wall and ceiling
    assert (BOX.canvas.pixels(behind, SIZE) < 0).all()


def test_parts_that_are_not_lit_keep_their_albedo() -> None:
    lit = np.full((len(BOX.room.faces), 3), 0.5)
    found = BOX.face_albedo(lit)
    for name, albedo in (("front", 0.5), ("back", 0.2), ("ceiling", 0.7)):
        own = BOX.room.part == BOX.room.names.index(name)
        assert (found[own] == albedo).all()


def test_equal_rooms_are_equal() -> None:
    same = RoomScreen(BOX.kind, BOX.size, BOX.lit, BOX.others)
    assert {BOX: 1}[same] == 1
