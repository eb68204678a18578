"""Rigid motions: the axioms of a group, and scipy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tolerances import CLOSED_FORM, SOLVER

from procam.maths.geometry.pose import Pose, align_rotation, rotation_matrix, rotation_vector

number = st.floats(-10, 10)
vector = st.tuples(number, number, number).map(np.array)
turn = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)  # a norm below pi
pose = st.builds(Pose.from_vectors, turn, vector)
POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [-4, 5, 6]])
LOOSE = 100 * CLOSED_FORM  # coordinates of some ten metres


class TestGroup:
    @given(p=pose)
    def test_inverse_undoes_on_either_side(self, p: Pose) -> None:
        np.testing.assert_allclose(p.inverse().apply(p.apply(POINTS)), POINTS, atol=LOOSE)
        np.testing.assert_allclose(p.apply(p.inverse().apply(POINTS)), POINTS, atol=LOOSE)
        np.testing.assert_allclose(p.inverse().inverse().apply(POINTS), p.apply(POINTS), atol=LOOSE)

    @given(p=pose, q=pose)
    def test_inverse_of_a_chain_is_the_chain_of_inverses_reversed(self, p: Pose, q: Pose) -> None:
        chain = Pose(p.rotation @ q.rotation, p.apply(q.translation))
        np.testing.assert_allclose(chain.apply(POINTS), p.apply(q.apply(POINTS)), atol=LOOSE)
        back = q.inverse().apply(p.inverse().apply(POINTS))
        np.testing.assert_allclose(chain.inverse().apply(POINTS), back, atol=LOOSE)

    @given(p=pose)
    def test_origin_is_what_maps_to_zero(self, p: Pose) -> None:
        np.testing.assert_allclose(p.apply(p.origin), np.zeros(3), atol=LOOSE)

    @given(p=pose)
    def test_directions_turn_but_do_not_move(self, p: Pose) -> None:
        np.testing.assert_allclose(
            p.rotate(POINTS), p.apply(POINTS) - p.apply(np.zeros(3)), atol=LOOSE
        )


class TestRotationVectors:
    @given(v=turn)
    def test_matrix_is_scipys(self, v: np.ndarray) -> None:
        expected = Rotation.from_rotvec(v).as_matrix()
        np.testing.assert_allclose(rotation_matrix(v), expected, atol=CLOSED_FORM)

    @pytest.mark.parametrize("size", [0.0, 1e-300, 1e-8, 1e-4, 3.1])
    def test_matrix_at_small_and_large_angles(self, size: float) -> None:
        v = size * np.array([2, -1, 2]) / 3
        expected = Rotation.from_rotvec(v).as_matrix()
        np.testing.assert_allclose(rotation_matrix(v), expected, atol=CLOSED_FORM)

    @given(v=turn.filter(lambda v: np.linalg.norm(v) < np.pi - 1e-3))
    def test_vector_is_the_inverse_of_matrix(self, v: np.ndarray) -> None:
        np.testing.assert_allclose(rotation_vector(rotation_matrix(v)), v, atol=SOLVER)

    @given(v=turn.filter(lambda v: np.linalg.norm(v) > 0.1))
    def test_half_a_turn(self, v: np.ndarray) -> None:
        matrix = rotation_matrix(np.pi * v / np.linalg.norm(v))
        np.testing.assert_allclose(rotation_matrix(rotation_vector(matrix)), matrix, atol=SOLVER)


class TestAlign:
    @given(v=turn)
    def test_two_directions_are_enough_and_never_mirror(self, v: np.ndarray) -> None:
        matrix = rotation_matrix(v)
        source = np.array([[1.0, 0, 0], [0.6, 0.8, 0]])
        found = align_rotation(source, source @ matrix.T)
        np.testing.assert_allclose(found, matrix, atol=SOLVER)
        assert np.linalg.det(found) == pytest.approx(1, abs=CLOSED_FORM)

    def test_noisy_directions_as_scipy_does(self, rng: np.random.Generator) -> None:
        source = rng.normal(size=(20, 3))
        target = source @ rotation_matrix([0.3, -1.0, 2.0]).T + rng.normal(0, 0.1, (20, 3))
        expected, _ = Rotation.align_vectors(target, source)
        np.testing.assert_allclose(
            align_rotation(source, target), expected.as_matrix(), atol=SOLVER
        )
