"""The mesh beside a calibration: read as it was written; what is damaged or of another room is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.calibration_entries import screen
from procam.files.mesh_file import NUMBERS, read_mesh, write_mesh
from procam.maths.mesh.rooms import Room, planned_room
from procam.model.screen import RoomScreen


@pytest.fixture
def room() -> Room:
    return planned_room("box", (4.0, 4.0, 3.0), ("front", "floor"), 300)


def test_it_is_read_as_it_was_written(room: Room, tmp_path: Path) -> None:
    write_mesh(tmp_path / "screen.npz", replace(room, smooth=True))
    found = read_mesh(tmp_path / "screen.npz")
    assert (found.names, found.size_m, found.smooth) == (room.names, room.size_m, True)
    for name in ("vertices", "faces", "part", "place"):
        np.testing.assert_array_equal(getattr(found, name), getattr(room, name))


def test_a_calibration_knows_its_own_mesh(room: Room) -> None:
    others = tuple((name, 0.2, 0.1) for name in ("left", "right", "back", "ceiling"))
    mesh = RoomScreen.of_mesh(room, ("front", "floor"), others)
    entry = {"kind": "mesh", "size": [4, 4, 3], "lit": ["front", "floor"], "digest": mesh.digest}
    entry["others"] = [list(other) for other in others]
    assert screen(entry, room) == mesh
    other = replace(room, vertices=room.vertices + 1e-9)
    with pytest.raises(ValueError, match="its mesh is another one, or altered"):
        screen(entry, other)


BAD = {
    "vertices": [np.zeros((3, 2)), np.zeros((0, 3)), np.full((400, 3), np.nan), np.zeros((1, 3))],
    "faces": [np.zeros((3, 3)), np.full((3, 3), -1), np.full((3, 3), 9999), np.zeros(3, int)],
    "part": [np.zeros(3, int), np.array(["a"])],
    "place": [np.zeros((3, 2))],
    "size_m": [np.zeros(3), np.array([0.0, 1.0]), np.array([np.nan, 1.0])],
}


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in BAD.items() for value in values]
)
def test_damage_is_refused(name: str, value: np.ndarray, room: Room, tmp_path: Path) -> None:
    arrays = {n: np.asarray(getattr(room, n)) for n in NUMBERS} | {name: value}
    np.savez(tmp_path / "screen.npz", names=np.array(room.names), **arrays)
    with pytest.raises(FileFormatError, match=r"the mesh of the room cannot be read .*; copy the"):
        read_mesh(tmp_path / "screen.npz")


def test_objects_are_not_unpickled(room: Room, tmp_path: Path) -> None:
    write_mesh(tmp_path / "screen.npz", replace(room, names=(object(),)))  # type: ignore[arg-type]
    with pytest.raises(FileFormatError, match="allow_pickle=False"):
        read_mesh(tmp_path / "screen.npz")


def test_a_flat_screen_has_an_extent_of_0(room: Room) -> None:
    mesh = RoomScreen.of_mesh(replace(room, vertices=room.vertices * [0, 1, 1]), ("front",), ())
    entry = {"kind": "mesh", "size": list(mesh.size), "lit": list(room.names), "others": []}
    found = screen({**entry, "digest": mesh.digest}, mesh.mesh)
    assert found.size[0] == 0  # type: ignore[union-attr]
