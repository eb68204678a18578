"""Rooms from OBJ files: parts by groups, the canvas by texture coordinates, and what is refused."""

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.obj import shared_text
from procam.files.venue.mesh_screen import MeshFile, read_room
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.rooms import Room
from simulators.room_obj import CANVAS_M, obj_text

LIT = ("front", "inner-front", "floor")
TEXT = obj_text()


def file_of(text: str, folder: Path, **change: object) -> MeshFile:
    path = folder / "room.obj"
    path.write_text(text, "utf-8")
    return replace(MeshFile(path, LIT, (1536, 2048)), **change)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Room:
    return read_room(file_of(TEXT, tmp_path_factory.mktemp("room")))


def areas(room: Room) -> dict[str, float]:
    area = face_areas(room.vertices, room.faces)
    return {name: float(area[room.part == i].sum()) for i, name in enumerate(room.names)}


def test_groups_are_parts(room: Room) -> None:
    found = areas(room)
    assert set(found) == {
        *("left", "front", "inner-right", "inner-front", "right", "back", "floor", "ceiling")
    }
    assert found["floor"] == pytest.approx(6 * 5 - 2.5 * 2)
    assert found["inner-front"] == pytest.approx(2.5 * 3)
    assert 3000 < len(room.faces) < 15000  # of 20


def test_lengths_on_the_canvas_are_those_on_the_screen(room: Room) -> None:
    assert room.size_m == pytest.approx(CANVAS_M)
    layout = room.layout()
    assert set(layout) == set(LIT)
    assert layout["inner-front"] == pytest.approx((3.5, 0, 2.5, 3))
    own = room.faces[room.part == room.names.index("front")][0]
    steps = room.vertices[own] - room.vertices[own[0]]
    places = room.place[own] - room.place[own[0]]
    np.testing.assert_allclose(places, steps @ np.array([[0, 0], [-1, 0], [0, -1]]), atol=1e-6)


def test_the_origin_is_where_it_is_set(tmp_path: Path) -> None:
    at = (-1.0, 1.0, 0.5)
    found = read_room(file_of(TEXT, tmp_path, origin_m=at))
    np.testing.assert_allclose(found.vertices.min(axis=0) + at, (-2.5, -3, -1.5))


def test_materials_split_nothing_and_objects_are_parts_where_there_are_no_groups(
    tmp_path: Path, room: Room
) -> None:
    text = TEXT.replace("\nf ", "\nusemtl paint\nf ").replace("\ng ", "\no ")
    assert areas(read_room(file_of(text, tmp_path))) == areas(room)


@pytest.mark.parametrize("change", [
    lambda text: text.replace("\n", "\r\n"), lambda text: "\ufeff" + text.replace("v ", "v\t "),
    lambda text: text.replace("f 1 2 3 4", "f 1 2 \\\n3 4"), lambda text: text + "s off\nl 1 2\n",
    lambda text: re.sub(r"(?m)^(vt .*)$", r"\1 0.0", text),
    lambda text: re.sub(r"(?m)^(v .*)$", r"\1 1 0.5 0", text),
    lambda text: text.replace("f 1 2 3 4", "f -4 -3 -2 -1"),
    lambda text: text.replace("f 1 2 3 4", "vn 0 -1 0\nf 1//1 2//1 3//1 4//1"),
    lambda text: re.sub(r"(\d+)/(\d+)", r"\1/\2/1", text + "vn 0 0 1\n"),
], ids=["CRLF", "BOM and tabs", "continued", "lines", "vt of 3", "colours", "negative",
        "normals", "all three"])  # fmt: skip
def test_what_exporters_write(tmp_path: Path, room: Room, change: Callable[[str], str]) -> None:
    file = file_of("", tmp_path)
    file.path.write_text(change(TEXT), "utf-8", newline="")
    assert areas(read_room(file)) == areas(room)


def test_faces_before_any_group_are_a_part(tmp_path: Path) -> None:
    text = TEXT.replace("g left\n", "")
    assert "part" in read_room(file_of(text, tmp_path)).names
    assert shared_text(tmp_path / "room.obj").count("g part-1\n") == 1


@pytest.mark.parametrize("first", range(6))
def test_a_polygon_with_an_inner_corner_has_its_area(tmp_path: Path, first: int) -> None:
    """The ceiling of the L as modellers write it, from any of its corners on."""
    points = "v 0.5 -0.5 1.5\nv 0.5 -3 1.5\nv -2.5 -3 1.5\n"
    corners = " ".join(map(str, np.roll([33, 34, 35, 37, 38, 39], -first)))
    text = TEXT[: TEXT.index("f 33")] + points + f"f {corners}\n"
    assert areas(read_room(file_of(text, tmp_path)))["ceiling"] == pytest.approx(25)


def test_a_smooth_wall_is_round_where_its_faces_are_cut(tmp_path: Path) -> None:
    """Twelve facets of half a cylinder are 43 mm off as they are."""
    angle = np.linspace(np.pi / 2, -np.pi / 2, 13)
    lines = [f"v {5 * np.cos(a):.9f} {5 * np.sin(a):.9f} {z}" for a in angle for z in (1.5, -1.5)]
    lines += [f"vt {i / 12:.9f} {v}" for i in range(13) for v in (1, 0)]
    for i in range(1, 25, 2):
        lines.append("f " + " ".join(f"{n}/{n}" for n in (i, i + 1, i + 3, i + 2)))
    file = file_of("\n".join(lines), tmp_path, lit=("part",), canvas=(5236, 1000))
    off = {
        smooth: np.abs(np.hypot(*read_room(replace(file, smooth=smooth)).vertices[:, :2].T) - 5)
        for smooth in (False, True)
    }
    assert off[False].max() > 0.04
    assert off[True].max() < 0.006


def test_one_group_of_nothing_leaves_the_objects(tmp_path: Path, room: Room) -> None:
    text = "g off\n" + TEXT.replace("\ng ", "\no ")
    assert areas(read_room(file_of(text, tmp_path))) == areas(room)


def test_names_become_names_of_files(tmp_path: Path) -> None:
    text = TEXT.replace("g front", "g the front.001")
    found = read_room(file_of(text, tmp_path, lit=("the-front-001", "floor")))
    assert "the-front-001" in found.names


def test_what_is_shared_has_nothing_private_and_reads_as_the_same(
    tmp_path: Path, room: Room
) -> None:
    private = "# annika@planetarium.example\nmtllib /home/annika/a.mtl\no secret\n"
    text = private + TEXT.replace("g inner-front", "g annika's wall")
    shared = shared_text(file_of(text, tmp_path).path)
    assert "annika" not in shared
    assert "secret" not in shared
    lit = ("front", "part-2", "floor")
    file = file_of(shared, tmp_path, lit=lit)
    np.testing.assert_array_equal(np.sort(read_room(file).vertices), np.sort(room.vertices))
    assert shared_text(file.path) == shared


BAD = {
    "no such group": (TEXT, {"lit": ("wall",)}, "no group 'wall', .* its groups are back, ceiling"),
    "no texture": (TEXT, {"lit": ("left",)}, r"group left has faces without texture .* unwrap it"),
    "outside": (
        TEXT.replace("vt 0 1\n", "vt 0 1.2\n", 1),
        {},
        "group front has .* outside of 0 to",
    ),
    "mirrored": (
        re.sub(r"vt (\S+)", lambda m: f"vt {1 - float(m[1]):g}", TEXT),
        {},
        "2 of 2 faces of group front .* mirrored; turn their texture over, or set screen.origin_m",
    ),
    "overlap": (
        TEXT.replace("f 13/5 14/6 15/7 16/8", "f 13/1 14/2 15/3 16/4"),
        {},
        r"2\d% of the lit faces lie over others .* move the texture islands apart",
    ),
    "not seen": (
        TEXT,
        {"origin_m": (-1.0, -2.0, 0.0)},
        r"the point \(-1, -2, 0\) does not see \d\d% of group front; set screen.origin_m",
    ),
    "millimetres": (
        re.sub(r"v (\S+) (\S+) (\S+)", lambda m: f"v {1e3 * float(m[1])} {m[2]} {m[3]}", TEXT),
        {},
        "extends over 5000 m, more than 500; .* scale it by 0.001",
    ),
    "no number": (
        TEXT.replace("v -2.5 3 1.5", "v nan 3 1.5", 1),
        {},
        "1 of .* are NaN or infinite",
    ),
    "no faces": ("v 0 0 1\nv 1 0 1\nv 0 1 1\n", {}, "not a readable OBJ mesh .* export it again"),
    "nothing": ("", {}, "not a readable OBJ mesh"),
    "prose": ("nothing of the kind", {}, "not a readable OBJ mesh"),
    "no such vertex": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", {}, "not a readable OBJ mesh"),
    "flat points": ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", {}, "not a readable OBJ mesh"),
    "aspect": (
        TEXT,
        {"canvas": (2048, 1536)},
        r"pictures of canvas = \[2048, 1536\] .* by 0\.56 in height; .* \[2048, 2731\] fits",
    ),
    "door on a wall": (
        TEXT
        + "g door\nv -1 2.999999 1\nv -1 2.999999 -1\nv 0 2.999999 -1\nv 0 2.999999 1\nf 41 42 43 44\n",
        {},
        "faces of group (door lie on faces of group left|left lie on faces of group door)",
    ),
    "one name": (TEXT.replace("g left", "g a b").replace("g back", "g a-b"), {}, "'a b' and 'a-b'"),
    "folds": (
        "v 0 0 1\nv 4 0 1\nv 4 4 1\nv 3 1 1\nv 2 4 1\nv 1 1 1\nv 0 4 1\nf 1 2 3 4 5 6 7\n",
        {},
        "a polygon of 7 corners has several that point inwards; triangulate",
    ),
    "on a vertex": (TEXT, {"origin_m": (2.5, 3.0, 1.5)}, "set screen.origin_m within the room"),
    "words": (TEXT.replace("f 1 2 3 4", "f 1 2 3 x"), {}, "'f 1 2 3 x' has words where numbers"),
    "a hole": (
        TEXT.replace("f 1 2 3 4\n", "").replace("f 17 18 19 20\n", ""),
        {},
        "1 hole besides the rim: .* a door can be a group that is not lit",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_a_screen_is_refused(case: str, tmp_path: Path) -> None:
    text, change, message = BAD[case]
    with pytest.raises(FileFormatError) as caught:
        read_room(file_of(text, tmp_path, **change))
    assert "\n" not in str(caught.value)
    assert re.search(message, str(caught.value)), str(caught.value)


def test_too_many_faces_are_refused_with_the_number_that_fits(tmp_path: Path) -> None:
    n = 400
    lines = [f"v {x} {y} {1 + 1e-6 * x * y}" for y in range(n) for x in range(n)]
    for y in range(n - 1):
        at = y * n + 1
        lines += [f"f {at + x} {at + x + 1} {at + x + n + 1} {at + x + n}" for x in range(n - 1)]
    with pytest.raises(FileFormatError, match="159201 faces; 100000 fit into memory, and 20000"):
        read_room(file_of("\n".join(lines), tmp_path, lit=("part",)))


def test_other_files_are_refused(tmp_path: Path) -> None:
    for name, message in (("gone.obj", "no such file; a mesh"), ("a.fbx", "read from .obj files")):
        with pytest.raises(FileFormatError, match=message):
            read_room(MeshFile(tmp_path / name, LIT, (8, 8)))


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(FileFormatError, match=r'trimesh, .* run: pip install "procam\[geom\]"'):
        read_room(file_of(TEXT, tmp_path))
