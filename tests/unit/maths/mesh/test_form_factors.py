"""Form factors of meshes: against closed forms and against rays of the tests' own."""

import mesh_shapes
import numpy as np
import pytest

from procam.maths.geometry.sphere import normalise
from procam.maths.mesh.exchange import is_convex
from procam.maths.mesh.facets import face_areas
from procam.maths.mesh.form_factors import form_factors

CUTS = 12
COLUMN_LOW, COLUMN_HIGH = np.array([0.4, 0.3, 0.0]), np.array([0.7, 0.5, 0.6])


def _walls(vertices: np.ndarray, faces: np.ndarray, factors: np.ndarray, walls: int) -> np.ndarray:
    """Form factors between groups of equally many faces, in order."""
    area = face_areas(vertices, faces)
    group = np.repeat(np.eye(walls), len(faces) // walls, axis=0)
    exchange = group.T @ (area[:, None] * factors.astype(float)) @ group
    return exchange / (group.T @ area)[:, None]


class TestCube:
    vertices, faces = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), CUTS)
    factors = form_factors(vertices, faces)

    def test_walls(self) -> None:
        found = _walls(self.vertices, self.faces, self.factors, 6)
        for i in range(6):
            for j in range(6):
                expected = 0.0 if i == j else 0.199824896 if i // 2 == j // 2 else 0.200043776
                assert found[i, j] == pytest.approx(expected, abs=1e-4)

    def test_no_light_is_lost(self) -> None:
        """Nothing is scaled: this is the error of the quadrature."""
        np.testing.assert_allclose(self.factors.sum(axis=1), 1.0, atol=1e-4)

    def test_reciprocity(self) -> None:
        exchange = face_areas(self.vertices, self.faces)[:, None] * self.factors.astype(float)
        np.testing.assert_allclose(exchange, exchange.T, rtol=3e-7)


def test_a_sphere_gives_every_face_its_share() -> None:
    """Paper eq. 7: F_ij = a_j / A_s for every pair. Flat faces fall short of it near each other."""
    half, faces = mesh_shapes.hemisphere(2.0, 18)
    whole = np.concatenate([half, half * [1, 1, -1]])
    vertices, faces = mesh_shapes.welded(whole, np.concatenate([faces, faces[:, ::-1] + len(half)]))
    factors, area = form_factors(vertices, faces), face_areas(vertices, faces)
    middle = normalise(vertices[faces].mean(axis=1))
    apart = middle @ middle.T < 0.9
    ratio = factors / (area / area.sum())
    assert np.std(ratio[apart]) < 0.01
    assert np.mean(ratio[apart]) == pytest.approx(1, abs=5e-3)


def test_an_open_dome_loses_what_leaves_it() -> None:
    """Half of the light of a hemisphere meets the hemisphere."""
    vertices, faces = mesh_shapes.hemisphere(3.0, 14)
    area = face_areas(vertices, faces)
    kept = area @ form_factors(vertices, faces).sum(axis=1) / area.sum()
    assert kept == pytest.approx(0.5, abs=2e-3)


def _room_with_column() -> tuple[np.ndarray, np.ndarray]:
    """A unit cube in which a column stands; 12 walls, the column's after the cube's."""
    outer, room = mesh_shapes.fine_box((0, 0, 0), (1, 1, 1), 10)
    inner, column = mesh_shapes.fine_box(tuple(COLUMN_LOW), tuple(COLUMN_HIGH), 5)
    return np.concatenate([outer, inner]), np.concatenate([room, column[:, ::-1] + len(outer)])


def _walls_met(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Number of the wall (N,) that rays in the room with a column meet first, as `box` counts them."""
    with np.errstate(divide="ignore"):
        ahead = np.where(direction > 0, 1 - origin, -origin) / direction
        near, far = (
            np.where((direction > 0) == first, COLUMN_LOW - origin, COLUMN_HIGH - origin)
            / direction
            for first in (True, False)
        )
    axis, enter = ahead.argmin(axis=1), near.max(axis=1)
    every = np.arange(len(origin))
    room = np.array([[0, 1], [2, 3], [4, 5]])[axis, (direction[every, axis] > 0).astype(int)]
    side = near.argmax(axis=1)
    column = 6 + np.array([[0, 1], [2, 3], [4, 5]])[side, (direction[every, side] < 0).astype(int)]
    return np.where((enter > 1e-9) & (enter < far.min(axis=1)), column, room)


def test_occluded_faces_exchange_no_light() -> None:
    vertices, faces = _room_with_column()
    factors = form_factors(vertices, faces)
    rng, count, first = np.random.default_rng(1), 400_000, 10 * 10 * 12
    for wall, axis in ((0, 0), (4, 2)):  # x = 0 and z = 0, of which the column hides a part
        origin = rng.uniform(size=(count, 3))
        origin[:, axis] = 0
        under = ((origin > COLUMN_LOW) & (origin < COLUMN_HIGH))[:, [0, 1]].all(axis=1)
        origin = origin[~under] if axis == 2 else origin
        up = np.sqrt(rng.uniform(1e-9, 1 - 1e-9, size=len(origin)))
        turn = rng.uniform(0, 2 * np.pi, len(origin))
        flat = np.sqrt(1 - up**2)
        direction = np.empty_like(origin)
        others = [i for i in range(3) if i != axis]
        direction[:, axis] = up
        direction[:, others[0]], direction[:, others[1]] = flat * np.cos(turn), flat * np.sin(turn)
        met = np.bincount(_walls_met(origin, direction), minlength=12) / count
        area = face_areas(vertices, faces)
        here = np.zeros(len(faces))
        here[wall * first // 6 : (wall + 1) * first // 6] = 1
        sent = (here * area) @ factors
        found = [
            *(part.sum() for part in np.split(sent[:first], 6)),
            *(part.sum() for part in np.split(sent[first:], 6)),
        ]
        np.testing.assert_allclose(found, met, atol=4e-3)


def test_convex_or_not() -> None:
    assert is_convex(*mesh_shapes.fine_box((0, 0, 0), (3, 2, 1), 3))
    assert is_convex(*mesh_shapes.hemisphere(2.0, 8))
    assert not is_convex(*_room_with_column())
