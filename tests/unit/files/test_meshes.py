"""Surfaces of meshes: valid ones are unchanged, small faults are mended, others refused in one line."""

import re
from pathlib import Path

import numpy as np
import pytest
from mesh_shapes import box, cylinder, hemisphere, scattered_sphere

from procam.errors import FileFormatError
from procam.files.meshes import Surface, checked

Mesh = tuple[np.ndarray, np.ndarray]


def surface(vertices: np.ndarray, faces: np.ndarray) -> Surface:
    """Of one part; texture coordinates tell corners apart."""
    texture = np.stack([faces, faces + 0.5], axis=-1).astype(float)
    return Surface(Path("a.obj"), vertices, faces, np.zeros(len(faces), int), texture)


def triangles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners (F, 3, 3), each face from its smallest vertex on, in a fixed order."""
    corners = vertices[faces].round(9)
    start = np.lexsort(np.moveaxis(corners, -1, 0), axis=-1)[:, 0]
    turned = np.take_along_axis(corners, (start[:, None, None] + np.arange(3)[:, None]) % 3, 1)
    return turned[np.lexsort(turned.reshape(len(turned), 9).T)]


def same(found: Surface, mesh: Mesh) -> None:
    np.testing.assert_allclose(triangles(found.vertices, found.faces), triangles(*mesh), atol=1e-9)


SHAPES = {
    "dome": hemisphere(8.0, 9),
    "panelled": hemisphere(8.0, 2),
    "room": box((-3, -4, -1), (5, 4, 3)),
    "tube": cylinder(5.0, 4.0, 40),
    "drum": cylinder(5.0, 4.0, 40, closed=True),
    "scan": scattered_sphere(6.0, 500),
}


def centred(name: str) -> Mesh:
    vertices, faces = SHAPES[name]
    return vertices - [0, 0, 2] if name in ("tube", "drum") else vertices, faces


class TestGoodMeshes:
    @pytest.mark.parametrize("name", SHAPES)
    def test_valid_meshes_are_unchanged(self, name: str) -> None:
        mesh = centred(name)
        same(checked(surface(*mesh)), mesh)

    def test_seams_are_welded(self) -> None:
        """Each face with corners of its own, as exporters leave them at texture seams."""
        vertices, faces = SHAPES["dome"]
        apart = vertices[faces].reshape(-1, 3) * (
            1 + 1e-9 * (np.arange(3 * len(faces))[:, None] % 5)
        )
        found = checked(surface(apart, np.arange(3 * len(faces)).reshape(-1, 3)))
        assert len(found.vertices) == len(vertices)
        assert len(found.faces) == len(faces)

    @pytest.mark.parametrize("name", SHAPES)
    def test_a_mesh_inside_out_is_turned(self, name: str) -> None:
        vertices, faces = centred(name)
        found = checked(surface(vertices, faces[:, ::-1]))
        same(found, (vertices, faces))
        np.testing.assert_array_equal(found.texture[..., 0], found.faces)  # turned with the face

    @pytest.mark.parametrize("name", ["dome", "room", "scan"])
    def test_some_reversed_faces_are_turned(self, name: str, rng: np.random.Generator) -> None:
        vertices, faces = SHAPES[name]
        spoilt = rng.permutation(len(faces)) < len(faces) // 3
        mixed = np.where(spoilt[:, None], faces[:, ::-1], faces)
        same(checked(surface(vertices, mixed)), (vertices, faces))

    @pytest.mark.parametrize("open_below", [False, True])
    def test_a_seat_faces_the_audience(self, open_below: bool) -> None:
        """A body in the room, whole or open where it stands, whichever way it was drawn."""
        (vertices, faces), (seat, walls) = SHAPES["room"], box((2, 1, -0.9), (3, 2, -0.2))
        walls = walls[:, ::-1]  # seen from outside
        if open_below:
            level = seat[walls][..., 2]
            walls = walls[level.max(axis=1) > level.min() + 0.01]
        both = np.concatenate([vertices, seat]), np.concatenate([faces, walls + len(vertices)])
        same(checked(surface(*both)), both)
        turned = np.concatenate([faces, walls[:, ::-1] + len(vertices)])
        same(checked(surface(both[0], turned)), both)

    @pytest.mark.parametrize("at", [(-2.9, 1.0), (4.5, 3.5)])
    def test_small_open_pieces_face_the_audience(self, at: tuple[float, float]) -> None:
        """A sign on a stand and a seat without a bottom, small as they are seen from the origin."""
        (vertices, faces), (x, y) = SHAPES["room"], at
        sign = np.array([[x, y, 0], [x, y + 0.2, 0], [x, y + 0.2, 0.2], [x, y, 0.2]])
        seen = sign[[0, 1, 2]][:, 0].mean() > 0  # beyond x = 0 it is seen from the left
        order = [[0, 2, 1], [0, 3, 2]] if seen else [[0, 1, 2], [0, 2, 3]]
        both = np.concatenate([vertices, sign]), np.concatenate([faces, np.array(order) + 8])
        same(checked(surface(*both)), both)
        turned = np.concatenate([faces, np.array(order)[:, ::-1] + 8])
        same(checked(surface(both[0], turned)), both)

    def test_faces_without_area_and_duplicates_are_dropped(self) -> None:
        vertices, faces = SHAPES["dome"]
        spoilt = np.concatenate([faces, [[3, 3, 5], [7, 8, 8]], faces[:4], faces[:1, ::-1]])
        same(checked(surface(vertices, spoilt)), (vertices, faces))

    def test_a_slit_without_width_is_no_hole(self) -> None:
        """A face of no area filled a crack between a long edge and two short ones."""
        vertices, faces = box((-3, -4, -1), (5, 4, 3))
        a, b, c = faces[0]
        middle = len(vertices)
        vertices = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
        faces = np.concatenate([faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
        assert len(checked(surface(vertices, faces)).faces) == 13

    def test_each_piece_may_have_a_rim(self) -> None:
        """Screens that do not touch."""
        vertices, faces = SHAPES["dome"]
        more = np.concatenate([vertices, [[9.0, 1, 1], [9.2, 1, 1], [9, 1.3, 1]]])
        piece = np.arange(3)[None] + len(vertices)
        assert len(checked(surface(more, np.concatenate([faces, piece]))).faces) == len(faces) + 1


def without(mesh: Mesh, azimuth_deg: float, elevation_deg: float, reach_deg: float) -> Mesh:
    """Without the faces within an angle of a direction."""
    vertices, faces = mesh
    middle = vertices[faces].mean(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    towards = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)]
    kept = middle @ [*towards, np.sin(elevation)] < np.cos(np.radians(reach_deg))
    return vertices, faces[kept]


class TestRefusals:
    def _refused(self, mesh: Mesh, text: str) -> None:
        with pytest.raises(FileFormatError) as caught:
            checked(surface(*mesh))
        message = str(caught.value)
        assert "\n" not in message
        assert re.search(text, message), message

    def test_nothing_but_faces_without_area(self) -> None:
        self._refused((np.eye(3), np.array([[0, 1, 1]])), "all 1 faces are without area")

    def test_a_hole_is_reported_with_its_place_and_size(self) -> None:
        mesh = without(hemisphere(8.0, 40), 40, 30, 5)
        self._refused(mesh, r"1 hole besides the rim: 1\.\d+ m across at azimuth (39|40|41)\.")
        self._refused(mesh, r"elevation (29|30|31)\.\d degrees\. Close holes")

    def test_many_holes_are_counted(self) -> None:
        mesh = hemisphere(8.0, 40)
        for azimuth in range(0, 360, 60):
            mesh = without(mesh, azimuth, 45, 3)
        self._refused(mesh, r"6 holes besides the rim: (.* across at .*; ){3}\.\.\.\. Close")

    def test_a_hole_at_the_pole_is_not_a_rim(self) -> None:
        mesh = without(hemisphere(8.0, 40), 0, 90, 8)
        self._refused(mesh, r"1 hole .* elevation 90\.0 degrees")

    def test_one_of_two_windows_is_a_hole(self) -> None:
        mesh = without(without(scattered_sphere(6.0, 3000), 0, 0, 10), 120, 0, 10)
        self._refused(mesh, "1 hole besides the rim")

    def test_a_surface_with_one_side(self) -> None:
        turn = np.linspace(0, 2 * np.pi, 41)[:-1]
        width = np.array([-0.5, 0.5])[:, None]
        reach = 4 + width * np.cos(turn / 2)
        strip = np.stack(
            [reach * np.cos(turn), reach * np.sin(turn), width * np.sin(turn / 2) + 0 * turn], -1
        ).reshape(-1, 3)
        n = np.arange(40)
        low, high = np.append(n, 40), np.append(n + 40, 0)  # the strip closes half a turn round
        faces = np.concatenate(
            [
                np.stack([low[:-1], low[1:], high[:-1]], 1),
                np.stack([low[1:], high[1:], high[:-1]], 1),
            ]
        )
        self._refused((strip, faces), "faces are on a surface with one side only; rebuild")

    def test_a_surface_that_branches(self) -> None:
        vertices, faces = SHAPES["dome"]
        vertices = np.concatenate([vertices, [[0.0, 0, 1]]])
        faces = np.concatenate([faces, [[*faces[20, :2], len(vertices) - 1]]])
        self._refused((vertices, faces), "1 edges have three faces or more, the first at azimuth")
