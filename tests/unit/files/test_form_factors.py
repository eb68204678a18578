"""Form factors beside a calibration: read as they were written, and never those of another room."""

from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.form_factors import read_form_factors, with_form_factors, write_form_factors
from procam.maths.mesh.rooms import planned_room
from procam.model.screen import RoomScreen


def _room(height_m: float = 3.0) -> RoomScreen:
    room = RoomScreen("box", (4.0, 4.0, height_m), ("front",), (("floor", 0.3, 0.1),))
    vars(room)["room"] = planned_room(room.kind, room.size, room.lit, 300)
    return room


def test_they_gather_light_as_before(tmp_path: Path) -> None:
    room, path = _room(), tmp_path / "factors.npz"
    write_form_factors(path, room)
    known = with_form_factors(_room(), path)
    assert known.has_factors and known == _room()
    light = np.random.default_rng(0).random((len(room.room.faces), 3))
    np.testing.assert_array_equal(known.factors.gather(light), room.factors.gather(light))


def test_those_of_another_room_are_computed_anew(tmp_path: Path) -> None:
    path = tmp_path / "factors.npz"
    write_form_factors(path, _room())
    with pytest.raises(FileFormatError, match="another mesh"):
        read_form_factors(path, _room(2.9))
    assert not with_form_factors(_room(2.9), path).has_factors


@pytest.mark.parametrize("content", [b"", b"PK", b"x" * 300])
def test_damage_is_computed_anew(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "factors.npz"
    path.write_bytes(content)
    assert not with_form_factors(_room(), path).has_factors
    assert not with_form_factors(_room(), tmp_path / "none.npz").has_factors


def test_another_albedo_keeps_what_was_computed() -> None:
    room = _room()
    factors = room.factors
    other = room.with_others((("floor", 0.5, 0.1),))
    assert other.factors is factors and other.room is room.room and other != room
    assert other.stated_albedo.max() == 0.5
