"""Response curves and sRGB."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import CLOSED_FORM, SOLVER

from procam.maths.light.curves import apply_curve, invert_curve, srgb_decode, srgb_encode

steps = st.lists(st.floats(0.01, 1.0), min_size=2, max_size=20)


def _table(step: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """A rising curve with the given increments, different per channel."""
    curve = np.cumsum([0.0, *step]) / sum(step)
    values = np.stack([curve, curve**1.5, np.sqrt(curve)], axis=1)
    return np.linspace(0, 1, len(curve)), values


@given(step=steps, drive=st.floats(0, 1))
def test_any_rising_curve_round_trips(step: list[float], drive: float) -> None:
    levels, values = _table(step)
    drives = np.full((1, 3), drive)
    back = invert_curve(apply_curve(drives, levels, values), levels, values)
    np.testing.assert_allclose(back, drives, atol=SOLVER)


@given(step=steps, linear=st.floats(0, 1))
def test_any_light_of_the_table_is_reached(step: list[float], linear: float) -> None:
    levels, values = _table(step)
    light = np.full((1, 3), linear)
    again = apply_curve(invert_curve(light, levels, values), levels, values)
    np.testing.assert_allclose(again, light, atol=SOLVER)


def test_channels_have_their_own_curves() -> None:
    levels, values = np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.25]])
    found = apply_curve(np.full((2, 1, 3), 0.5), levels, values)
    np.testing.assert_array_equal(found, np.broadcast_to([0.5, 0.25, 0.125], (2, 1, 3)))


def test_light_outside_the_table_is_clipped() -> None:
    levels, values = _table([0.2, 0.3])
    assert invert_curve(np.array([[-1.0, 2.0, 0.0]]), levels, values).tolist() == [[0.0, 1.0, 0.0]]


class TestSrgb:
    @pytest.mark.parametrize(
        ("encoded", "linear"),
        [(0.0, 0.0), (1.0, 1.0), (0.5, 0.21404114048223255), (0.02, 0.02 / 12.92)],
    )
    def test_published_values(self, encoded: float, linear: float) -> None:
        assert float(srgb_decode(np.array(encoded))) == pytest.approx(linear, abs=CLOSED_FORM)

    @given(linear=st.floats(0, 1))
    def test_round_trip(self, linear: float) -> None:
        back = srgb_decode(srgb_encode(np.array(linear)))
        # the two segments of the standard agree only to 3e-8
        assert float(back) == pytest.approx(linear, abs=1e-7)

    def test_negative_light_is_black(self) -> None:
        assert float(srgb_encode(np.array(-0.5))) == 0.0
