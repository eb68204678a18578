"""Local shifts: exact at their points, local, bounded, without folds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import CLOSED_FORM, FLOAT32

from procam.maths.geometry.local_shift import REACH, LocalShift

SIZE = (96, 60)
REACH_PX = REACH * 96
COORDINATES = st.tuples(st.floats(0, 95), st.floats(0, 59))
SHIFTS = st.tuples(st.floats(-3, 3), st.floats(-3, 3))


def panel(step: float = 1.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0, 96, step), np.arange(0, 60, step))
    return np.stack([x, y], axis=-1)


def moved(*points: tuple[float, float, float, float]) -> LocalShift:
    """Points x, y that move by dx, dy."""
    table = np.array(points, float)
    return LocalShift.on_panel(SIZE, table[:, :2], table[:, 2:])


def largest_turn(shift: LocalShift, places: np.ndarray, step: float = 1e-4) -> float:
    """Least determinant of the slope of where places come from; below 0 the picture is folded."""
    ahead = [(places + d) - shift.at(places + d) for d in (np.array([step, 0]), [0, step])]
    behind = [(places - d) - shift.at(places - d) for d in (np.array([step, 0]), [0, step])]
    slope = [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)]
    return float((slope[0][..., 0] * slope[1][..., 1] - slope[0][..., 1] * slope[1][..., 0]).min())


class TestShift:
    def test_shifts_are_exact_at_their_points(self) -> None:
        shift = moved((20, 30, 2, -1), (60, 20, -0.5, 0.25))
        now = np.array([[22.0, 29], [59.5, 20.25]])
        np.testing.assert_allclose(now - shift.at(now), [[20, 30], [60, 20]], rtol=CLOSED_FORM)

    def test_nothing_moves_beyond_the_reach(self) -> None:
        shift = moved((48, 30, 2, 1))
        places = panel()
        far = np.linalg.norm(places - np.array([50, 31]), axis=-1) >= REACH_PX
        by = shift.at(places)
        assert not by[far].any() and by[~far].all()

    def test_it_falls_monotonically_and_no_steeper_than_three_halves_of_its_reach(self) -> None:
        along = np.linspace(0, REACH_PX, 500)
        shift = moved((10, 30, 2, 0))
        by = shift.at(np.stack([12 + along, np.full(500, 30.0)], axis=-1))[:, 0]
        slope = np.diff(by) / np.diff(along)
        assert (slope <= 0).all()
        assert slope.min() == pytest.approx(-1.5 * 2 / REACH_PX, rel=1e-4)

    def test_equal_neighbours_move_what_is_between_them_as_far(self) -> None:
        shift = moved((40, 30, 2, 1), (46, 30, 2, 1))
        between = shift.at(np.array([[45.0, 31]]))
        np.testing.assert_allclose(between, [[2, 1]], rtol=0.15)

    @given(st.lists(st.tuples(COORDINATES, SHIFTS), min_size=1, max_size=5), COORDINATES)
    def test_never_more_than_the_largest_shift(
        self, points: list[tuple[tuple[float, float], tuple[float, float]]], place: tuple
    ) -> None:
        """However close the points are: a weighted mean of their shifts and of 0."""
        by = np.array([p[1] for p in points])
        found = LocalShift.on_panel(SIZE, np.array([p[0] for p in points]), by).at(np.array(place))
        assert (found <= np.maximum(by.max(axis=0), 0) + FLOAT32).all()
        assert (found >= np.minimum(by.min(axis=0), 0) - FLOAT32).all()

    def test_no_points_move_nothing(self) -> None:
        none = LocalShift.on_panel(SIZE, np.zeros((0, 2)), np.zeros((0, 2)))
        assert not none.at(panel()).any() and none.first_fold() is None


class TestTorn:
    def test_one_point_may_move_by_two_thirds_of_the_reach(self) -> None:
        assert moved((48, 30, 0.66 * REACH_PX, 0)).first_fold() is None
        assert moved((48, 30, 0, -0.68 * REACH_PX)).first_fold() == 0

    def test_neighbours_that_change_places(self) -> None:
        still, here, there = (10, 10, 0, 1), (50, 30, 2, 0), (53, 30, -2, 0)
        assert moved(still, here, there).first_fold() == 1
        assert moved(still, here, (53, 30, 1, 0)).first_fold() is None

    def test_one_place_asked_for_twice(self) -> None:
        assert moved((10, 10, 0, 1), (50, 30, 2, 0), (54, 30, -2, 0)).first_fold() == 1

    @given(st.lists(st.tuples(COORDINATES, SHIFTS), min_size=2, max_size=3))
    def test_what_is_not_called_torn_folds_nowhere(
        self, points: list[tuple[tuple[float, float], tuple[float, float]]]
    ) -> None:
        pixels, by = (np.array(column) for column in zip(*points, strict=True))
        shift = LocalShift.on_panel(SIZE, pixels, by)
        if shift.first_fold() is None:
            assert largest_turn(shift, panel(0.5)) > 0
