"""Compressed form factors against all of them one by one, closed forms, and what they must keep."""

from functools import cache

import mesh_shapes
import numpy as np
import pytest

from procam.maths.mesh.clusters import Clusters, children
from procam.maths.mesh.compressed import CompressedFactors, compressed_factors
from procam.maths.mesh.cross_approximation import cross_approximation, recompressed
from procam.maths.mesh.exchange import Exchange
from procam.maths.mesh.facets import face_areas, face_normals


def l_room(cuts: int) -> mesh_shapes.Mesh:
    """Its arms are of unlike lengths, so that no ray between faces runs along the inner edge."""
    vertices, faces = mesh_shapes.cell_room({(0, 0, 0), (1, 0, 0), (0, 1, 0)}, cuts)
    return vertices + np.maximum(vertices - 1, 0) * [0.37, 0.11, 0.0], faces


MESHES = {
    "box": mesh_shapes.cell_room({(0, 0, 0)}, 10),
    "L": l_room(8),
    "dome": mesh_shapes.hemisphere(4.0, 18),
    "sphere of odd faces": mesh_shapes.scattered_sphere(2.0, 600),
}


@cache
def factors_of(name: str) -> CompressedFactors:
    return compressed_factors(*MESHES[name])


@pytest.mark.parametrize("name", MESHES)
class TestAgainstDense:
    def test_light_is_that_of_every_pair(self, name: str, rng: np.random.Generator) -> None:
        """Half lit, a spot in a corner, noise; of the mean of what arrives."""
        vertices, faces = MESHES[name]
        factors, every = factors_of(name), np.arange(len(faces))
        exchange = Exchange(vertices, faces)
        middle = vertices[faces].mean(axis=1)
        half = middle[:, 0] < np.median(middle[:, 0])
        spot = np.linalg.norm(middle - middle[0], axis=1) < 0.2
        light = np.stack([half, spot, rng.uniform(0, 1, len(faces))], axis=1)
        dense = exchange.between(every[:, None], every[None]) / exchange.area[:, None]
        expected, found = dense @ light, factors.gather(light)
        off = (found - expected) / expected.mean(axis=0)
        assert np.sqrt(np.mean(off**2, axis=0)).max() < 5e-4
        assert np.abs(off).max() < 5e-3

    def test_reciprocity_is_exact(self, name: str, rng: np.random.Generator) -> None:
        """x.(X y) = y.(X x), and `spread` is the transpose of `gather`."""
        factors = factors_of(name)
        x, y = rng.uniform(0, 1, (2, len(factors.area), 1))
        assert float((x * factors.exchange(y)).sum()) == pytest.approx(
            float((y * factors.exchange(x)).sum()), rel=1e-6
        )
        assert float((x * factors.gather(y)).sum()) == pytest.approx(
            float((y * factors.spread(x)).sum()), rel=1e-6
        )


def test_no_light_is_lost_in_a_closed_room() -> None:
    """Rows sum to 1 and are not scaled."""
    vertices, faces = mesh_shapes.cell_room({(0, 0, 0)}, 16)
    sums = compressed_factors(vertices, faces, tolerance=3e-4).gather(np.ones((len(faces), 1)))
    np.testing.assert_allclose(sums, 1.0, atol=1e-3)


def test_walls_of_a_cube() -> None:
    """Closed forms of parallel and perpendicular squares."""
    vertices, faces = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), 12)
    wall = np.repeat(np.eye(6), len(faces) // 6, axis=0)
    factors = compressed_factors(vertices, faces, tolerance=3e-4)
    found = wall.T @ factors.exchange(wall)
    for i in range(6):
        for j in range(6):
            expected = 0.0 if i == j else 0.199824896 if i // 2 == j // 2 else 0.200043776
            assert found[i, j] == pytest.approx(expected, abs=1e-4)


def test_what_stands_between_casts_a_shadow() -> None:
    """The ends of an L do not see each other."""
    vertices, faces = MESHES["L"]
    middle, normal = vertices[faces].mean(axis=1), face_normals(vertices, faces)
    one = (middle[:, 0] > 1.9) & (normal[:, 0] < -0.5)
    other = (middle[:, 1] > 1.9) & (normal[:, 1] < -0.5)
    seen = factors_of("L").gather(one[:, None].astype(float))[:, 0]
    assert np.abs(seen[other]).max() < 1e-3 * seen.max()


def test_memory_grows_slower_than_pairs() -> None:
    few, many = (mesh_shapes.cell_room({(0, 0, 0)}, cuts) for cuts in (12, 24))
    sizes = [compressed_factors(*mesh).nbytes for mesh in (few, many)]
    assert sizes[1] < 8 * sizes[0]
    assert sizes[1] < 0.25 * 4 * len(many[1]) ** 2


def test_progress_is_shown_to_the_end() -> None:
    shares = list[float]()
    compressed_factors(*MESHES["box"], progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0


class TestClusters:
    def test_every_face_is_in_one_slot(self, rng: np.random.Generator) -> None:
        corners = rng.normal(0, 1, (1000, 3, 3))
        tree = Clusters.of(corners, rng.normal(0, 1, (1000, 3)), leaf=30)
        assert sorted(tree.face[tree.face >= 0]) == list(range(1000))
        assert ((tree.members(tree.depth) < 0).sum(axis=1) <= 1).all()
        assert tree.members(tree.depth).shape[1] <= 30

    def test_pairs_cover_the_matrix_once(self) -> None:
        pairs = np.zeros((1, 2), np.intp)
        for _ in range(4):
            pairs = children(pairs)
        assert len({tuple(pair) for pair in pairs}) == len(pairs) == 16 * 17 / 2
        assert (pairs[:, 0] <= pairs[:, 1]).all()


class TestCrossApproximation:
    def test_blocks_of_low_rank_are_exact(self, rng: np.random.Generator) -> None:
        blocks = [rng.normal(0, 1, (30, k)) @ rng.normal(0, 1, (k, 40)) for k in (1, 3, 6)]
        full = np.stack(blocks).astype(np.float32)
        found = cross_approximation(lambda b, i, j: full[b[:, None], i, j], (3, 30, 40), 1e-5)
        small = recompressed(found, 1e-4)
        assert found.ended.all()
        assert small.rank.tolist() == [1, 3, 6]
        again = np.einsum("bkm,bkn->bmn", small.left, small.right)
        np.testing.assert_allclose(again, full, atol=2e-3)

    def test_rows_of_nothing_are_passed_over(self, rng: np.random.Generator) -> None:
        full = np.zeros((1, 20, 20), np.float32)
        full[0, 15:] = rng.normal(0, 1, (5, 1)) * rng.normal(0, 1, 20)
        found = cross_approximation(lambda b, i, j: full[b[:, None], i, j], (1, 20, 20), 1e-5)
        np.testing.assert_allclose(
            np.einsum("bkm,bkn->bmn", found.left, found.right), full, atol=1e-5
        )

    def test_what_has_no_low_rank_does_not_end(self, rng: np.random.Generator) -> None:
        full = rng.normal(0, 1, (1, 60, 60)).astype(np.float32)
        found = cross_approximation(lambda b, i, j: full[b[:, None], i, j], (1, 60, 60), 1e-3)
        assert not found.ended[0]


def test_areas_are_those_of_the_faces() -> None:
    vertices, faces = MESHES["dome"]
    np.testing.assert_allclose(factors_of("dome").area, face_areas(vertices, faces))
