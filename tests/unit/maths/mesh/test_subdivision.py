"""Meshes cut into smaller triangles: the same surface, without cracks."""

import numpy as np
import pytest
from mesh_shapes import box, scattered_sphere

from procam.maths.mesh.facets import face_areas, face_normals, half_edges
from procam.maths.mesh.subdivision import subdivided

SHAPES = {"box": box((-3, -2, -1), (5, 4, 3)), "scan": scattered_sphere(6.0, 50)}


@pytest.mark.parametrize("shape", SHAPES)
def test_edges_are_short_and_the_surface_is_the_same(shape: str) -> None:
    vertices, faces = SHAPES[shape]
    numbered = np.c_[vertices, vertices @ [1.0, 2.0, 3.0]]
    cut, parts, origin = subdivided(numbered, faces.astype(np.intp), 0.4, 100_000)
    edge = half_edges(parts)
    assert np.linalg.norm(np.diff(cut[edge][..., :3], axis=1), axis=-1).max() <= 0.4
    assert (np.unique(np.sort(edge, axis=1), axis=0, return_counts=True)[1] == 2).all()
    areas = np.bincount(origin, face_areas(cut[:, :3], parts))
    np.testing.assert_allclose(areas, face_areas(vertices, faces))
    normals = face_normals(vertices, faces)[origin]
    np.testing.assert_allclose(face_normals(cut[:, :3], parts), normals, atol=1e-9)
    np.testing.assert_allclose(cut[:, 3], cut[:, :3] @ [1.0, 2.0, 3.0])


def test_it_ends_at_the_most_faces() -> None:
    vertices, faces = SHAPES["box"]
    _, parts, _ = subdivided(vertices, faces.astype(np.intp), 1e-6, 500)
    assert 500 / 4 < len(parts) <= 500
