"""The Levenberg-Marquardt iteration on problems with known minima."""

from collections.abc import Callable

import numpy as np
import pytest

from procam.maths.levenberg import minimise

Array = np.ndarray


def problem(
    residual: Callable[[Array], Array], jacobian: Callable[[Array], Array]
) -> tuple[Callable[[Array], float], Callable[[Array], Callable[[float], Array]]]:
    def linearise(x: Array) -> Callable[[float], Array]:
        rows = jacobian(x)
        matrix, gradient = rows.T @ rows, rows.T @ residual(x)

        def trial(damping: float) -> Array:
            return x - np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient)

        return trial

    return lambda x: float(np.sum(residual(x) ** 2)), linearise


ROSENBROCK = problem(
    lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
    lambda x: np.array([[-20 * x[0], 10.0], [-1.0, 0.0]]),
)


def test_a_curved_valley() -> None:
    x, converged = minimise(np.array([-1.2, 1.0]), *ROSENBROCK)
    assert converged
    np.testing.assert_allclose(x, [1, 1], atol=1e-6)


def test_a_linear_problem_with_a_residual_that_stays() -> None:
    design = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]])
    values = np.array([0.0, 1.0, 1.0])
    x, converged = minimise(np.zeros(2), *problem(lambda x: design @ x - values, lambda x: design))
    assert converged
    np.testing.assert_allclose(x, np.linalg.lstsq(design, values, rcond=None)[0], atol=1e-9)


def test_too_few_iterations() -> None:
    start = np.array([-1.2, 1.0])
    x, converged = minimise(start, *ROSENBROCK, iterations=3)
    assert not converged
    assert ROSENBROCK[0](x) < ROSENBROCK[0](start)


@pytest.mark.parametrize("bad", [np.inf, np.nan])
def test_impossible_states_are_not_entered(bad: float) -> None:
    """The minimum of (log x)^2 from far away, where a full step leads to negative x."""
    cost, linearise = problem(lambda x: np.log(np.abs(x)), lambda x: np.diag(1 / x))
    x, converged = minimise(np.array([20.0]), lambda x: cost(x) if x[0] > 0 else bad, linearise)
    assert converged
    np.testing.assert_allclose(x, 1, atol=1e-6)


def test_an_impossible_start_is_returned() -> None:
    x, converged = minimise(np.array([3.0]), lambda x: np.inf, lambda x: lambda damping: x)
    assert (x[0], converged) == (3.0, False)
