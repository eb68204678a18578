"""Rooms in calibration.json: what is damaged is refused, whatever stands there."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from procam.errors import InputError
from procam.files.calibration_entries import screen
from procam.model.screen import Dome, RoomScreen

ROOM = RoomScreen("cylinder", (5.0, 120.0, 3.0), ("wall",), (("floor", 0.2, 0.1),))
ENTRY = json.loads(json.dumps(asdict(ROOM)))


def test_a_room_is_read_as_it_was_written() -> None:
    assert screen(ENTRY) == ROOM


def test_walls_that_moved_are_read_as_they_were_written() -> None:
    moved = replace(ROOM, moved=(("wall", (0.01, 0.0, 0.002, 0.0, 0.0, -0.001, 0.0)),))
    assert screen(json.loads(json.dumps(asdict(moved)))) == moved
    narrow = RoomScreen("cylinder", (20.0, 40.0, 5.0), ("wall",), (("floor", 0.2, 0.1),))
    shape = narrow.shape.with_free_walls()  # its seven numbers are large, and nearly cancel
    moves = np.full(shape.moves.size, 0.02 / shape.radius_m)
    solved = narrow.solved(replace(shape, harmonic_coefficients=np.r_[1.0, moves]))
    assert screen(json.loads(json.dumps(asdict(solved)))) == solved
    before = {key: value for key, value in ENTRY.items() if key != "moved"}
    assert screen(before) == ROOM  # of files that were written before walls could move


def test_without_a_kind_it_is_a_dome() -> None:
    assert isinstance(screen(asdict(Dome(6.0, 1.5))), Dome)


@pytest.mark.parametrize("change", [
    {"size": [1e9, 120, 3]}, {"size": [5, 7, 3]}, {"size": [5, 120]}, {"size": [5, 120, None]},
    {"kind": "box"}, {"kind": "sphere"}, {"kind": 3}, {"lit": []}, {"lit": None}, {"lit": ["roof"]},
    {"others": []}, {"others": [["floor"]]}, {"others": [["floor", 2, 0]]}, {"others": 7},
    {"moved": 7}, {"moved": [["wall", [0.1]]]}, {"moved": [["roof", [0.0] * 7]]},
    {"moved": [["wall", [9.0] + [0.0] * 6]]}, {"moved": [["floor", [0.0] * 7]]},
    {"moved": [["wall", [0.0] * 7]] * 2}, {"moved": [["wall", [None] * 7]]},
], ids=str)  # fmt: skip
def test_damage_is_refused(change: dict[str, object]) -> None:
    with pytest.raises((ValueError, TypeError, LookupError, InputError)):
        screen({**ENTRY, **change})
