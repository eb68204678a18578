"""Normals of meshes, and the smooth surfaces that they sample."""

import numpy as np
import pytest
from mesh_shapes import cylinder, hemisphere, scattered_sphere
from tolerances import CLOSED_FORM

from procam.maths.mesh.facets import (
    corner_normals,
    face_normals,
    half_edges,
    patch_points,
    patches,
    shared_edges,
)


class TestEdges:
    def test_each_half_edge_of_a_closed_mesh_has_its_partner(self) -> None:
        faces = scattered_sphere(2.0, 100)[1]
        pairs = shared_edges(faces)
        assert sorted(pairs.ravel()) == list(range(3 * len(faces)))
        edges = half_edges(faces)
        np.testing.assert_array_equal(edges[pairs[:, 0]], edges[pairs[:, 1]][:, ::-1])

    def test_a_rim_has_none(self) -> None:
        faces = hemisphere(2.0, 5)[1]
        assert 3 * len(faces) - 2 * len(shared_edges(faces)) == 4 * 5

    def test_an_edge_of_three_faces_is_not_shared(self) -> None:
        faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
        assert len(shared_edges(faces)) == 0

    def test_pairs_are_found_whichever_way_they_run(self) -> None:
        assert shared_edges(np.array([[0, 1, 2], [0, 1, 3]])).tolist() == [[0, 3]]


class TestNormals:
    def test_of_any_mesh_of_a_sphere_are_exact(self) -> None:
        vertices, faces = scattered_sphere(3.0, 400)
        found = corner_normals(vertices, faces)
        assert np.abs(found + vertices[faces] / 3.0).max() < 100 * CLOSED_FORM

    @pytest.mark.parametrize("steps", [1, 7, 40])
    def test_at_the_rim_of_a_hemisphere_too(self, steps: int) -> None:
        vertices, faces = hemisphere(3.0, steps)
        if steps == 1:  # faces meet at more than 30 degrees: an octahedron, not a sphere
            expected = np.repeat(face_normals(vertices, faces)[:, None], 3, axis=1)
        else:
            expected = -vertices[faces] / 3.0
        tolerance = {1: CLOSED_FORM, 2: 0.6}.get(steps, 1e-6)
        assert np.abs(corner_normals(vertices, faces) - expected).max() < tolerance

    @pytest.mark.parametrize("closed", [False, True])
    def test_of_a_cylinder_turn_with_the_wall_and_stop_at_the_floor(self, closed: bool) -> None:
        vertices, faces = cylinder(5.0, 4.0, 30, closed)
        found, flat = corner_normals(vertices, faces), face_normals(vertices, faces)
        wall = np.abs(flat[:, 2]) < 0.5
        expected = np.where(
            wall[:, None, None], -vertices[faces] * [1, 1, 0] / 5.0, flat[:, None, :]
        )
        np.testing.assert_allclose(found, expected, atol=CLOSED_FORM)


class TestPatches:
    def test_are_the_formula(self, rng: np.random.Generator) -> None:
        """Half way from the flat point to the mean of its feet on the corners' tangent planes."""
        corners, normals = rng.normal(0, 1, (2, 3, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        weights = np.array([0.2, 0.5, 0.3])
        flat = weights @ corners
        height = np.sum((flat - corners) * normals, axis=1)
        expected = flat - (weights * height) @ normals / 2
        found = patches(corners, np.array([[0, 1, 2]]), normals[None])
        point = patch_points(found, weights[[1]], weights[[2]])[0][0]
        np.testing.assert_allclose(point, expected, atol=CLOSED_FORM)

    def test_slopes_are_those_of_the_surface(self, rng: np.random.Generator) -> None:
        found = rng.normal(0, 1, (5, 6, 3))
        u, v = rng.uniform(0, 0.5, (2, 5))
        _, along_u, along_v = patch_points(found, u, v)
        for slope, (du, dv) in ((along_u, (1e-6, 0)), (along_v, (0, 1e-6))):
            ahead = patch_points(found, u + du, v + dv)[0]
            behind = patch_points(found, u - du, v - dv)[0]
            np.testing.assert_allclose((ahead - behind) / 2e-6, slope, atol=1e-8)

    def test_leave_no_gap_at_shared_edges(self, rng: np.random.Generator) -> None:
        vertices, faces = scattered_sphere(3.0, 600)
        found = patches(vertices, faces, corner_normals(vertices, faces))
        t = rng.uniform(0, 1)
        place = {0: (t, 0.0), 1: (1 - t, t), 2: (0.0, 1 - t)}  # u, v at t along each edge
        back = {0: (1 - t, 0.0), 1: (t, 1 - t), 2: (0.0, t)}  # and at 1 - t
        pairs = shared_edges(faces)
        sides = []
        for half_edge, at in ((pairs[:, 0], place), (pairs[:, 1], back)):
            u, v = np.array([at[k] for k in half_edge % 3]).T
            sides.append(patch_points(found[half_edge // 3], u, v)[0])
        np.testing.assert_allclose(*sides, atol=CLOSED_FORM)

    @pytest.mark.parametrize("steps", [10, 40])
    def test_meet_a_sphere_to_the_fourth_order(self, steps: int) -> None:
        """At the middle of an edge of angle t the radius is 1 - 9/384 t^4 (series by hand)."""
        vertices, faces = hemisphere(1.0, steps)
        found = patches(vertices, faces, -vertices[faces])
        half, none = np.full(len(faces), 0.5), np.zeros(len(faces))
        middle = patch_points(found, half, none)[0]
        a, b = vertices[faces[:, 0]], vertices[faces[:, 1]]
        angle = 2 * np.arcsin(np.linalg.norm(a - b, axis=1) / 2)
        lack = 1 - np.linalg.norm(middle, axis=1)
        np.testing.assert_allclose(lack, 9 / 384 * angle**4, rtol=0.02)
