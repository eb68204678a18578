"""Rooms by their dimensions, and their canvases."""

import numpy as np
import pytest

from procam.errors import InputError
from procam.maths.mesh.canvas import mesh_canvas
from procam.maths.mesh.facets import face_areas, face_normals
from procam.maths.mesh.rooms import BOX, Room, box_room, cylinder_room

ALL_WALLS = ("left", "front", "right", "back")


def places(room: Room, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) of a part, and their places on the canvas."""
    used = np.unique(room.faces[room.part == room.names.index(name)])
    return room.vertices[used], room.place[used]


@pytest.fixture(scope="module")
def box() -> Room:
    return box_room((6.0, 4.0, 3.0), BOX, 0.5)


def test_a_box_is_closed_and_faces_look_inside(box: Room) -> None:
    areas, normals = face_areas(box.vertices, box.faces), face_normals(box.vertices, box.faces)
    assert areas.sum() == pytest.approx(2 * (6 * 4 + 6 * 3 + 4 * 3))
    middle = box.vertices[box.faces].mean(axis=1)
    assert (np.einsum("fi,fi->f", normals, middle) < 0).all()
    np.testing.assert_allclose(np.abs(box.vertices).max(axis=0), [2, 3, 1.5])


def test_its_walls_lie_in_a_strip_as_the_audience_sees_them(box: Room) -> None:
    layout = box.layout()
    assert layout == {
        "left": (0.0, 4.0, 4.0, 3.0),
        "front": (4.0, 4.0, 6.0, 3.0),
        "right": (10.0, 4.0, 4.0, 3.0),
        "back": (14.0, 4.0, 6.0, 3.0),
        "floor": (4.0, 7.0, 6.0, 4.0),
        "ceiling": (4.0, 0.0, 6.0, 4.0),
    }
    assert box.size_m == (20.0, 11.0)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("left", "front"),
        ("front", "right"),
        ("right", "back"),
        ("front", "floor"),
        ("ceiling", "front"),
    ],
)
def test_walls_that_touch_on_the_canvas_touch_in_the_room(box: Room, one: str, other: str) -> None:
    (points, at), (others, there) = places(box, one), places(box, other)
    apart = np.linalg.norm(at[:, None] - there, axis=2)
    first, second = np.nonzero(apart < 1e-9)
    assert len(first) > 4
    np.testing.assert_allclose(points[first], others[second], atol=1e-9)


def test_lengths_on_the_canvas_are_those_on_the_screen(box: Room) -> None:
    for room in (box, cylinder_room(5.0, np.radians(120), 3.0, ["wall"], 0.1)):
        lit = room.faces[np.isfinite(room.place[room.faces]).all(axis=(1, 2))]
        for a, b in ((0, 1), (1, 2), (2, 0)):
            steps = (x[lit[:, a]] - x[lit[:, b]] for x in (room.vertices, room.place))
            length, drawn = (np.linalg.norm(step, axis=1) for step in steps)
            np.testing.assert_allclose(drawn, length, rtol=1e-4)


def test_a_part_that_is_not_lit_has_no_place() -> None:
    room = box_room((6.0, 4.0, 3.0), ["front", "floor"], 0.5)
    assert room.layout() == {"front": (0.0, 0.0, 6.0, 3.0), "floor": (0.0, 3.0, 6.0, 4.0)}
    assert np.isnan(places(room, "left")[1]).all()


def test_a_cylinder_and_its_floor() -> None:
    room = cylinder_room(5.0, np.radians(120), 3.0, ["wall"], 0.25)
    areas, number = face_areas(room.vertices, room.faces), room.part
    assert areas[number == 0].sum() == pytest.approx(5 * np.radians(120) * 3, rel=1e-3)
    assert areas[number == 1].sum() == pytest.approx(25 * np.radians(120) / 2, rel=1e-3)
    points, at = places(room, "wall")
    left = points[at[:, 0].argmin()]
    np.testing.assert_allclose(
        left[:2], 5 * np.array([np.cos(np.radians(60)), np.sin(np.radians(60))])
    )
    normals = face_normals(room.vertices, room.faces)
    assert (np.einsum("fi,fi->f", normals, room.vertices[room.faces[:, 0]])[number == 0] < 0).all()
    assert (normals[number == 1, 2] > 0.999).all()


@pytest.mark.parametrize("make", [
    lambda: box_room((6.0, 0.0, 3.0), BOX, 0.5),
    lambda: box_room((6.0, np.nan, 3.0), BOX, 0.5),
    lambda: box_room((6.0, 4.0, 3.0), ["roof"], 0.5),
    lambda: box_room((6.0, 4.0, 3.0), [], 0.5),
    lambda: cylinder_room(5.0, 7.0, 3.0, ["wall"], 0.5),
    lambda: cylinder_room(-5.0, 1.0, 3.0, ["wall"], 0.5),
    lambda: cylinder_room(5.0, 1.0, 3.0, ["wall", "floor"], 0.5),
])  # fmt: skip
def test_what_is_no_room_is_refused(make) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=r"above 0|10 to 360|name some of|no place on the canvas"):
        make()


class TestCanvas:
    SIZE = (200, 110)

    @pytest.fixture
    def room(self, box: Room) -> Room:
        return box

    def test_each_pixel_is_on_its_wall(self, room: Room) -> None:
        canvas = mesh_canvas(
            room.vertices, room.faces, room.part, room.place / room.size_m, self.SIZE
        )
        assert room.names[room.part[canvas.face[55, 70]]] == "front"
        assert room.names[room.part[canvas.face[55, 10]]] == "left"
        assert room.names[room.part[canvas.face[90, 70]]] == "floor"
        assert canvas.face[90, 10] == -1 and not canvas.area[90, 10]
        assert canvas.area.sum() == pytest.approx(108, rel=1e-3)
        np.testing.assert_allclose(canvas.area[canvas.lit], 0.01, rtol=1e-5)

    def test_linear_fields_are_exact_up_to_the_edges_and_means_come_back(self, room: Room) -> None:
        canvas = mesh_canvas(
            room.vertices, room.faces, room.part, room.place / room.size_m, self.SIZE
        )
        slope = np.array([[0.3], [-0.2], [0.5]])
        middle = room.vertices[room.faces].mean(axis=1)
        field = canvas.field(middle @ slope + 2)
        point = (canvas.at_pixels @ room.vertices).reshape(*canvas.face.shape, 3)
        np.testing.assert_allclose(field[canvas.lit], (point @ slope + 2)[canvas.lit], atol=1e-5)
        assert not field[~canvas.lit].any()
        np.testing.assert_allclose(canvas.mean(field), middle @ slope + 2, atol=0.03)

    def test_faces_smaller_than_a_pixel_have_the_light_of_the_nearest(self, room: Room) -> None:
        place = room.place / room.size_m
        canvas = mesh_canvas(room.vertices, room.faces, room.part, place, (20, 11))
        picture = np.arange(20 * 11 * 3, dtype=np.float32).reshape(11, 20, 3)
        means = canvas.mean(picture)
        at = np.floor(room.place[room.faces].mean(axis=1)).astype(int)  # pixels are metres
        for face in canvas.small[0]:
            x, y = at[face]
            assert np.abs(means[face] - picture[y, x]).max() <= 3 * 21

    def test_nothing_lit_is_refused(self, room: Room) -> None:
        place = room.place / room.size_m
        with pytest.raises(InputError, match="no face has a place"):
            mesh_canvas(room.vertices, room.faces, room.part, place * np.nan, self.SIZE)
