"""Walls that are not where they were drawn."""

import numpy as np
import pytest

from procam.maths.mesh.rooms import Room, planned_room
from procam.maths.mesh.wall_moves import WallMoves, moved_by, outwards

BOX = planned_room("box", (6.0, 5.0, 3.0), ("front", "left", "floor"), 600)
CYLINDER = planned_room("cylinder", (4.0, 200.0, 3.0), ("wall",), 600)
DRUM = planned_room("cylinder", (4.0, 360.0, 3.0), ("wall",), 600)
NARROW = planned_room("cylinder", (20.0, 40.0, 5.0), ("wall",), 600)


def _moved(room: Room, **numbers: list[float]) -> np.ndarray:
    moves = {room.names.index(name): np.array(by, float) for name, by in numbers.items()}
    return room.vertices + moved_by(room.vertices, room.faces, room.part, moves)


def test_a_wall_further_out_is_a_longer_room() -> None:
    moved = _moved(BOX, front=[0.02, 0, 0, 0, 0, 0, 0])
    on_front = np.isclose(BOX.vertices[:, 0], 2.5)
    np.testing.assert_allclose(moved[on_front, 0], 2.52)  # with the edges of its neighbours
    np.testing.assert_allclose(moved[on_front, 1:], BOX.vertices[on_front, 1:], atol=1e-12)
    np.testing.assert_array_equal(moved[~on_front], BOX.vertices[~on_front])


def test_a_turned_wall_keeps_its_neighbours_flat() -> None:
    angle = 0.01
    moved = _moved(BOX, front=[0, 0, 0, 0, 0, 0, angle])  # about z: towards the left it goes in
    on_front, on_floor = np.isclose(BOX.vertices[:, 0], 2.5), np.isclose(BOX.vertices[:, 2], -1.5)
    np.testing.assert_allclose(moved[on_front, 0], 2.5 - angle * BOX.vertices[on_front, 1])
    np.testing.assert_allclose(moved[on_floor, 2], -1.5)


def test_a_cylinder_grows() -> None:
    moved = _moved(CYLINDER, wall=[0.03, 0, 0, 0, 0, 0, 0])
    wall = np.unique(CYLINDER.faces[CYLINDER.part == CYLINDER.names.index("wall")])
    np.testing.assert_allclose(np.hypot(*moved[wall, :2].T), 4.03, atol=1e-4)
    np.testing.assert_allclose(moved[wall, 2], CYLINDER.vertices[wall, 2], atol=3e-5)


@pytest.mark.parametrize(
    ("room", "name", "ways"),
    [
        (BOX, "front", 3),
        (BOX, "floor", 3),
        (CYLINDER, "wall", 5),
        (DRUM, "wall", 5),
        (NARROW, "wall", 4),
    ],
)
def test_independent_ways_to_move(room: Room, name: str, ways: int) -> None:
    part = room.names.index(name)
    moves = WallMoves.of(room.vertices, room.faces, room.part, [part])
    assert moves.fields.shape == (ways, len(room.vertices), 3)
    along = outwards(room.vertices, room.faces[room.part == part], moves.numbers)
    np.testing.assert_allclose(along @ along.T / along.shape[1], np.eye(ways), atol=1e-9)
    by = {part: np.array([0.01, 0.02, -0.01, 0.03, 0.001, 0.002, -0.001])}
    given = moved_by(room.vertices, room.faces, room.part, by)
    amount = outwards(room.vertices, room.faces[room.part == part], by[part]) @ along.T
    found = np.tensordot(amount / along.shape[1], moves.fields, 1)
    limit = 0.1 if room is NARROW else 1e-3  # what a narrow arc hardly shows is left out
    assert np.abs(found - given).max() < limit * np.abs(given).max()
