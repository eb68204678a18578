"""Exact compensation: the flux against bisection, the light against a general solver and KKT."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq, lsq_linear
from tolerances import SOLVER

import procam.maths.light.box_solver
from procam.errors import DidNotConverge
from procam.maths.light.box_solver import solve_moments

Problem = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _problem(patches: int, seed: int, hardness: float) -> Problem:
    """Target, u, a, lo, hi; `hardness` 0 clips nothing, 3 nearly everything."""
    rng = np.random.default_rng(seed)
    solid = rng.uniform(0.1, 1, patches) * 6 / patches
    scatter = rng.uniform(0.02, 0.12, patches)
    target = rng.uniform(0, 1, patches) ** (1 + 2 * hardness) * 1.2
    lo, hi = rng.uniform(0, 0.02, patches), rng.uniform(0.8, 1.1, patches)
    if hardness == 0:
        lo, hi, target = lo - 9, hi + 9, target + 0.5
    return target, scatter, solid, lo, hi


def solve_flux(
    target: np.ndarray, scatter: np.ndarray, solid: np.ndarray, lo: np.ndarray, hi: np.ndarray
) -> float:
    """The one moment of a bare sphere, its flux."""
    return float(solve_moments(target, scatter[:, None], solid[:, None], lo, hi)[0])


def _light(problem: Problem, value: float) -> np.ndarray:
    target, scatter, _, lo, hi = problem
    return np.clip(target - scatter * value, lo, hi)


problems = st.builds(
    _problem,
    st.integers(1, 60),
    st.integers(0, 2**31),
    st.sampled_from([0.0, 0.5, 1.0, 3.0]),
)


@given(problem=problems)
def test_flux_by_bisection(problem: Problem) -> None:
    solid, lo, hi = problem[2:]

    def residual_flux(value: float) -> float:
        return float(solid @ _light(problem, value)) - value

    expected = brentq(residual_flux, solid @ lo - 1, solid @ hi + 1, xtol=1e-14, rtol=1e-14)
    assert solve_flux(*problem) == pytest.approx(expected, rel=1e-10, abs=1e-11)


@given(problem=problems)
def test_unclipped_patches_are_exact(problem: Problem) -> None:
    target, scatter, solid, lo, hi = problem
    direct = _light(problem, solve_flux(*problem))
    total = direct + scatter * (solid @ direct)
    free = (direct > lo) & (direct < hi)
    np.testing.assert_allclose(total[free], target[free], atol=1e-10)


@given(problem=problems)
def test_residuals_of_clipped_patches_point_outwards(problem: Problem) -> None:
    """KKT: the total is above the target where clipped at lo, below it where clipped at hi."""
    target, scatter, solid, lo, hi = problem
    direct = _light(problem, solve_flux(*problem))
    residual = direct + scatter * (solid @ direct) - target
    assert (residual[direct == lo] >= -SOLVER).all()
    assert (residual[direct == hi] <= SOLVER).all()


@pytest.mark.parametrize("seed", range(3))
def test_energy_norm_minimiser_by_a_general_solver(seed: int) -> None:
    """The solution minimises 1/2 x'(diag(a/u) + a a')x - (a t/u)'x within the box."""
    target, scatter, solid, lo, hi = problem = _problem(25, seed, 1.0)
    matrix = np.diag(solid / scatter) + np.outer(solid, solid)
    root = np.linalg.cholesky(matrix).T
    right = np.linalg.solve(root.T, solid * target / scatter)
    expected = lsq_linear(root, right, bounds=(lo, hi), method="bvls", tol=1e-14).x
    direct = _light(problem, solve_flux(*problem))
    assert ((direct == lo) | (direct == hi)).any()  # or the test would test nothing
    np.testing.assert_allclose(direct, expected, atol=SOLVER)


@pytest.mark.parametrize("seed", range(20))
def test_moments_of_strong_scatter_are_solved(seed: int) -> None:
    """Scatter so strong that whole Newton steps run in circles between sets of limits."""
    rng = np.random.default_rng(seed)
    collect, root = rng.uniform(0, 2, (40, 3)), rng.normal(size=(3, 3))
    collect[:, 1:] -= collect[:, 1:].mean(axis=0)
    spread = 4 * collect @ (root @ root.T)
    target, lo = rng.uniform(-3, 6, 40), rng.uniform(0, 0.1, 40)
    hi = lo + rng.uniform(0.01, 1, 40)
    found = solve_moments(target, spread, collect, lo, hi)
    direct = np.clip(target - spread @ found, lo, hi)
    np.testing.assert_allclose(collect.T @ direct, found, atol=1e-9)


def test_a_large_picture_takes_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of linear segments, not of digits, sets the number of Newton steps."""
    monkeypatch.setattr(procam.maths.light.box_solver, "MAX_STEPS", 12)
    problem = _problem(200_000, 3, 1.0)
    value = solve_flux(*problem)
    assert problem[2] @ _light(problem, value) == pytest.approx(value, rel=1e-10)


def test_unknown_scatter_is_refused() -> None:
    ones = np.ones(3)
    with pytest.raises(DidNotConverge, match="scatter_per_flux"):
        solve_flux(ones, np.full(3, np.nan), ones, 0 * ones, ones)
