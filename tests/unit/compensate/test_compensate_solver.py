"""Roots in few evaluations, of equations whose roots are known."""

from collections.abc import Callable

import numpy as np
import pytest

from procam.compensate.solver import Root
from procam.errors import DidNotConverge

Residual = Callable[[np.ndarray, bool], np.ndarray]
Slope = Callable[[np.ndarray], np.ndarray]


def falling(root: float, slope: float) -> Residual:
    return lambda value, _: slope * (value - root)


def known(slope: float) -> Slope:
    return lambda value: np.full((len(value), 1, 1), slope)


def start() -> Root:
    return Root(np.zeros((1, 1)), np.full((1, 1, 1), -1.0))


@pytest.mark.parametrize("slope", [-1.3, -0.8])
def test_the_last_pictures_slope_is_not_trusted_across_a_cut(slope: float) -> None:
    """Nearly the same root, other limits: the step must be evaluated before it is taken."""
    root = start()
    for place in (1.0, 1.001, 1.0, 1.001):
        root.follow(falling(place, -1.002), known(-1.002), 1e-5)
    root.follow(falling(1.0035, slope), known(slope), 1e-5)
    assert root.value[0, 0] == pytest.approx(1.0035, rel=2e-5)


def test_piecewise_slopes() -> None:
    """Where a limit takes hold on the way, the slope is taken anew."""

    def residual(value: np.ndarray, _: bool) -> np.ndarray:
        return 3.0 - value - 2.0 * np.maximum(value - 1.0, 0)

    root = start()
    root.follow(residual, lambda value: np.where(value > 1, -3.0, -1.0)[..., None], 1e-9)
    assert root.value[0, 0] == pytest.approx(5 / 3, rel=1e-9)


def test_colours_rest_one_by_one() -> None:
    target = np.array([[0.0], [1.0], [5.0]])
    root = Root(np.zeros((3, 1)), np.full((3, 1, 1), -2.0))
    root.follow(lambda v, _: target - v, lambda v: np.full((3, 1, 1), -1.0), 1e-9)
    np.testing.assert_allclose(root.value, target, rtol=1e-9)


@pytest.mark.parametrize(
    ("slope", "residuals"), [(-1.0, (1.1e-5, 9e-6)), (-1.2e-5, (1.2e-5, 1.5e-5))]
)
def test_a_step_within_the_tolerance_is_not_repeated(
    slope: float, residuals: tuple[float, float]
) -> None:
    """Rounding is left, from where no step goes further; the second one doubles the value."""
    left = list(residuals)
    root = Root(np.ones((1, 1)), np.full((1, 1, 1), slope))
    root.follow(lambda *_: np.full((1, 1), left.pop(0)), known(slope), 1e-5)
    assert not left


def test_a_residual_that_stands_still_is_reported() -> None:
    with pytest.raises(DidNotConverge, match="check scatter_per_flux"):
        start().follow(lambda v, _: np.ones((1, 1)), known(-1.0), 1e-9)


def test_what_has_no_root_is_reported() -> None:
    with pytest.raises(DidNotConverge, match="not solved after 40 steps"):
        start().follow(lambda v, _: 1 + v * v, known(-1.0), 1e-9)
