"""load_mesh: valid screens are unchanged, faults are corrected or refused in one line."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_shapes import box, cylinder, hemisphere, scattered_sphere

from procam.errors import FileFormatError
from procam.files.meshes import load_mesh

Mesh = tuple[np.ndarray, np.ndarray]


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices]
    lines += ["f " + " ".join(f"{n + 1}" for n in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_ply(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Binary, as scanners write it."""
    header = f"""ply
format binary_little_endian 1.0
element vertex {len(vertices)}
property float64 x
property float64 y
property float64 z
element face {len(faces)}
property list uchar int vertex_indices
end_header
"""
    room = np.zeros(len(faces), [("n", "u1"), ("v", "<i4", 3)])
    room["n"], room["v"] = 3, faces
    body = vertices.astype("<f8").tobytes() + room.tobytes()
    path.write_bytes(header.encode() + body)
    return path


def triangles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Corners (F, 3, 3), each face from its smallest vertex on, in a fixed order."""
    corners = vertices[faces].round(9)
    start = np.lexsort(np.moveaxis(corners, -1, 0), axis=-1)[:, 0]
    turned = np.take_along_axis(corners, (start[:, None, None] + np.arange(3)[:, None]) % 3, 1)
    return turned[np.lexsort(turned.reshape(len(turned), 9).T)]


def same(screen: object, mesh: Mesh) -> None:
    np.testing.assert_allclose(
        triangles(screen.vertices, screen.faces), triangles(*mesh), atol=1e-9
    )


SHAPES = {
    "dome": hemisphere(8.0, 9),
    "panelled": hemisphere(8.0, 2),
    "room": box((-3, -4, -1), (5, 4, 3)),
    "tube": cylinder(5.0, 4.0, 40),
    "drum": cylinder(5.0, 4.0, 40, closed=True),
    "scan": scattered_sphere(6.0, 500),
}


class TestGoodMeshes:
    @pytest.mark.parametrize("name", SHAPES)
    @pytest.mark.parametrize("write", [write_obj, write_ply])
    def test_valid_meshes_are_unchanged(self, name: str, write: object, tmp_path: Path) -> None:
        vertices, faces = SHAPES[name]
        vertices = vertices - [0, 0, 2] if name in ("tube", "drum") else vertices
        screen = load_mesh(write(tmp_path / f"a.{write.__name__[-3:]}", vertices, faces))
        same(screen, (vertices, faces))
        assert screen.vertices.dtype == np.float64
        assert screen.faces.dtype == np.int32
        assert not screen.smooth

    def test_polygons_become_triangles(self, tmp_path: Path) -> None:
        path = tmp_path / "wall.obj"
        path.write_text("v 3 -1 0\nv 3 1 0\nv 3 1 2\nv 3 -1 2\nf 1 4 3 2\n")
        assert len(load_mesh(path).faces) == 2

    def test_seams_are_welded(self, tmp_path: Path) -> None:
        """Each face with corners of its own, as exporters leave them at texture seams."""
        vertices, faces = SHAPES["dome"]
        apart = vertices[faces].reshape(-1, 3) * (
            1 + 1e-9 * (np.arange(3 * len(faces))[:, None] % 5)
        )
        screen = load_mesh(
            write_obj(tmp_path / "a.obj", apart, np.arange(3 * len(faces)).reshape(-1, 3))
        )
        assert len(screen.vertices) == len(vertices)
        assert len(screen.faces) == len(faces)

    @pytest.mark.parametrize("shape", ["dome", "room"])
    def test_vertices_of_no_face_are_left_out(self, shape: str, tmp_path: Path) -> None:
        vertices, faces = SHAPES[shape]
        more = np.concatenate([[[0.0, 0, 9]], vertices, [[1.0, 2, 3]]])
        assert len(load_mesh(write_obj(tmp_path / "a.obj", more, faces + 1)).vertices) == len(
            vertices
        )


class TestRepairs:
    @pytest.mark.parametrize("name", SHAPES)
    def test_a_mesh_inside_out_is_reversed(self, name: str, tmp_path: Path) -> None:
        vertices, faces = SHAPES[name]
        vertices = vertices - [0, 0, 2] if name in ("tube", "drum") else vertices
        path = write_obj(tmp_path / "a.obj", vertices, faces[:, ::-1])
        message = rf"a\.obj: {len(faces)} of {len(faces)} faces pointed outwards; reversed"
        with pytest.warns(UserWarning, match=message):
            screen = load_mesh(path)
        same(screen, (vertices, faces))

    @pytest.mark.parametrize("name", ["dome", "room", "scan"])
    def test_some_reversed_faces_are_corrected(
        self, name: str, tmp_path: Path, rng: np.random.Generator
    ) -> None:
        vertices, faces = SHAPES[name]
        spoilt = rng.permutation(len(faces)) < len(faces) // 3
        mixed = np.where(spoilt[:, None], faces[:, ::-1], faces)
        message = f"{spoilt.sum()} of {len(faces)} faces pointed outwards; reversed"
        with pytest.warns(UserWarning, match=message):
            screen = load_mesh(write_obj(tmp_path / "a.obj", vertices, mixed))
        same(screen, (vertices, faces))

    def test_faces_without_area_and_duplicates_are_dropped(self, tmp_path: Path) -> None:
        vertices, faces = SHAPES["dome"]
        spoilt = np.concatenate([faces, [[3, 3, 5], [7, 8, 8]], faces[:4], faces[:1, ::-1]])
        with pytest.warns(
            UserWarning, match=rf"7 of {len(spoilt)} faces had no area or were drawn"
        ):
            screen = load_mesh(write_obj(tmp_path / "a.obj", vertices, spoilt))
        same(screen, (vertices, faces))

    def test_a_slit_without_width_is_no_hole(self, tmp_path: Path) -> None:
        """A face of no area filled a crack between a long edge and two short ones."""
        vertices, faces = box((-3, -4, -1), (5, 4, 3))
        a, b, c = faces[0]
        middle = len(vertices)
        vertices = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
        faces = np.concatenate([faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
        with pytest.warns(UserWarning, match="1 of 14 faces had no area"):
            screen = load_mesh(write_obj(tmp_path / "a.obj", vertices, faces))
        assert len(screen.faces) == 13


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
    def _refused(self, path: Path, text: str) -> None:
        with pytest.raises(FileFormatError) as caught:
            load_mesh(path)
        message = str(caught.value)
        assert "\n" not in message
        assert re.search(text, message), message

    def test_no_such_file(self, tmp_path: Path) -> None:
        self._refused(tmp_path / "gone.ply", r"gone\.ply: no such file; a mesh is needed\. Check")

    def test_other_formats(self, tmp_path: Path) -> None:
        self._refused(tmp_path / "dome.fbx", r"read from \.obj and \.ply files; export it")

    @pytest.mark.parametrize(
        ("name", "content"),
        [
            ("a.ply", b"nothing of the kind"),
            ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
            ("a.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n"),
            ("a.ply", b"ply\nformat ascii 1.0\nelement face many\nend_header\n"),
        ],
    )
    def test_what_cannot_be_read(self, name: str, content: bytes, tmp_path: Path) -> None:
        (tmp_path / name).write_bytes(content)
        self._refused(
            tmp_path / name, f"{name} is not a readable OBJ or PLY mesh .*; export it again"
        )

    @pytest.mark.parametrize("content", ["", "v 0 0 1\nv 1 0 1\nv 0 1 1\n", "nothing of the kind"])
    def test_points_without_faces(self, content: str, tmp_path: Path) -> None:
        (tmp_path / "a.obj").write_text(content)
        self._refused(tmp_path / "a.obj", "no faces; make a surface of the points")

    def test_a_torn_binary(self, tmp_path: Path) -> None:
        path = write_ply(tmp_path / "a.ply", *SHAPES["dome"])
        path.write_bytes(path.read_bytes()[:-500])
        self._refused(path, "is not a readable OBJ or PLY mesh")

    def test_a_torn_text(self, tmp_path: Path) -> None:
        (tmp_path / "a.ply").write_text(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
            "property float z\nelement face 9\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 1\n1 0 1\n0 1 1\n3 0 1 2\n"
        )
        self._refused(tmp_path / "a.ply", "1 of the 9 faces in its header; copy")

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_vertices_that_are_nan(self, value: float, tmp_path: Path) -> None:
        vertices, faces = SHAPES["dome"]
        vertices = vertices.copy()
        vertices[[3, 5], 1] = value
        path = write_ply(tmp_path / "a.ply", vertices, faces)
        self._refused(path, f"2 of {len(vertices)} vertices are NaN or infinite; delete")

    def test_faces_of_vertices_that_are_not_there(self, tmp_path: Path) -> None:
        vertices, faces = SHAPES["room"]
        path = write_ply(tmp_path / "a.ply", vertices, np.where(faces == 7, 70, faces))
        self._refused(path, "a face has vertex 70, but there are 8; export")

    def test_millimetres(self, tmp_path: Path) -> None:
        vertices, faces = SHAPES["dome"]
        path = write_obj(tmp_path / "a.obj", 1000 * vertices, faces)
        self._refused(path, "it extends over 16000 m, more than 500; .* millimetres, scale")

    def test_nothing_but_faces_without_area(self, tmp_path: Path) -> None:
        path = write_obj(tmp_path / "a.obj", np.eye(3), np.array([[0, 1, 1]]))
        self._refused(path, "all 1 faces are without area")

    def test_a_hole_is_reported_with_its_place_and_size(self, tmp_path: Path) -> None:
        mesh = without(hemisphere(8.0, 40), 40, 30, 5)
        path = write_obj(tmp_path / "a.obj", *mesh)
        self._refused(path, r"1 hole besides the rim: 1\.\d+ m across at azimuth (39|40|41)\.")
        self._refused(path, r"elevation (29|30|31)\.\d degrees\. Close holes")

    def test_many_holes_are_counted(self, tmp_path: Path) -> None:
        mesh = hemisphere(8.0, 40)
        for azimuth in range(0, 360, 60):
            mesh = without(mesh, azimuth, 45, 3)
        path = write_obj(tmp_path / "a.obj", *mesh)
        self._refused(path, r"6 holes besides the rim: (.* across at .*; ){3}\.\.\.\. Close")

    def test_a_hole_at_the_pole_is_not_a_rim(self, tmp_path: Path) -> None:
        path = write_obj(tmp_path / "a.obj", *without(hemisphere(8.0, 40), 0, 90, 8))
        self._refused(path, r"1 hole .* elevation 90\.0 degrees")

    def test_one_of_two_windows_is_a_hole(self, tmp_path: Path) -> None:
        mesh = without(without(scattered_sphere(6.0, 3000), 0, 0, 10), 120, 0, 10)
        self._refused(write_obj(tmp_path / "a.obj", *mesh), "1 hole besides the rim")

    def test_a_loose_piece_has_a_rim_of_its_own(self, tmp_path: Path) -> None:
        vertices, faces = SHAPES["dome"]
        vertices = np.concatenate([vertices, [[1.0, 1, 1], [1.2, 1, 1], [1, 1.3, 1]]])
        faces = np.concatenate([faces, [np.arange(3) + len(vertices) - 3]])
        with pytest.warns(UserWarning, match="1 of"):
            self._refused(
                write_obj(tmp_path / "a.obj", vertices, faces[:, [0, 1, 2]]), "delete loose pieces"
            )

    def test_a_surface_with_one_side(self, tmp_path: Path) -> None:
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
        path = write_obj(tmp_path / "a.obj", strip, faces)
        self._refused(path, "faces are on a surface with one side only; rebuild")

    def test_a_surface_that_branches(self, tmp_path: Path) -> None:
        vertices, faces = SHAPES["dome"]
        vertices = np.concatenate([vertices, [[0.0, 0, 1]]])
        faces = np.concatenate([faces, [[*faces[20, :2], len(vertices) - 1]]])
        path = write_obj(tmp_path / "a.obj", vertices, faces)
        self._refused(path, "1 edges have three faces or more, the first at azimuth")


def test_a_missing_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    path = write_obj(tmp_path / "a.obj", *SHAPES["room"])
    with pytest.raises(FileFormatError, match=r'trimesh, .* run: pip install "procam\[geom\]"'):
        load_mesh(path)
