"""Small dataclasses that check or compute something."""

import numpy as np
import pytest

from procam.errors import UnitError
from procam.model.plan import Plan, Shot
from procam.model.screen import Dome
from procam.model.transport import Measured


class TestDome:
    @pytest.mark.parametrize("radius_m", [0.0, -3.0])
    def test_radius_must_be_a_length(self, radius_m: float) -> None:
        expected = rf"^radius_m is {radius_m}; it needs a length above 0 metres$"
        with pytest.raises(UnitError, match=expected):
            Dome(radius_m, 1.5)

    @pytest.mark.parametrize("half_angle", [0.0, -1.0, 90.0])
    def test_half_angle_must_be_an_angle_in_radians(self, half_angle: float) -> None:
        expected = rf"^half_angle is {half_angle} rad; it needs an angle between 0 and pi$"
        with pytest.raises(UnitError, match=expected):
            Dome(6.0, half_angle)

    @pytest.mark.parametrize("field", [(np.nan, 1.5), (6.0, np.nan)])
    def test_unknown_numbers_are_refused(self, field: tuple[float, float]) -> None:
        with pytest.raises(UnitError):
            Dome(*field)


def test_interval_is_two_sided_95_percent() -> None:
    low, high = Measured(np.array([1.0]), np.array([0.1])).interval()
    assert (low[0], high[0]) == (pytest.approx(0.804), pytest.approx(1.196))


class TestPlan:
    plan = Plan(
        (
            Shot("dark", "", "", "dark", (0.1, 5.0)),
            Shot("a-0", "a", "p0", "white", (0.1,)),
            Shot("a-1", "a", "p1", "code", (0.1,)),
            Shot("b-0", "b", "p2", "white", (0.1,)),
            Shot("a-2", "a", "p3", "code", (0.1, 0.2)),
        )
    )

    def test_shots_of_a_projector_come_in_order(self) -> None:
        assert [s.id for s in self.plan.of("a", "code")] == ["a-1", "a-2"]
        assert self.plan.of("c", "code") == []

    def test_exposures_counts_photographs(self) -> None:
        assert self.plan.exposures == 7
