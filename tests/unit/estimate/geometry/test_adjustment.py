"""Statistics of residuals, priors, and the robust phase of the bundle adjustment."""

import numpy as np
import pytest
from domes import SimulatedDome, step_between

from procam.estimate.geometry.adjustment import (
    CELLS,
    Adjustment,
    _with_correlated_misfit,
    descent,
    prior_departures,
    prior_sigmas,
    systematic_ratio,
)
from procam.estimate.geometry.model import Observations, ParameterLayout

SIZE = (800, 600)


def _observations(rng: np.random.Generator, count: int = 20_000) -> Observations:
    return Observations(
        np.zeros((count, 2)), rng.uniform(0, 1, (count, 2)) * SIZE, np.full(count, 0.1)
    )


def test_damped_steps_do_not_creep_where_undamped_ones_overshoot() -> None:
    """A parameter that is determined 1e8 times worse than others, four times as far as it looks."""
    tried = list[float]()

    def step_at(damping: float) -> np.ndarray:
        tried.append(damping)
        return np.array([4e-8 / (1e-8 + damping)])

    step, gain, damping = descent(step_at, lambda step: float((step[0] - 1) ** 2), 1e-14)
    assert tried == [1e-14, 1e-6] and damping == 1e-6
    assert 0.5 < step[0] < 1.5 and gain > 0.7
    step, gain, damping = descent(lambda d: 1 / (1 + np.array([d])), _nan_beyond_half, 1e-14)
    assert damping >= 1 and step[0] <= 0.5 and gain > 0
    step, gain, damping = descent(step_at, lambda step: float((step[0] - 4) ** 2), 1e-14)
    assert (damping, step[0]) == (1e-14, pytest.approx(4)) and gain == pytest.approx(16)


def _nan_beyond_half(step: np.ndarray) -> float:
    return float((step[0] - 1) ** 2) if step[0] <= 0.5 else np.nan


def test_independent_errors_have_the_ratio_1(rng: np.random.Generator) -> None:
    seen = _observations(rng)
    error = rng.normal(0, 0.1, (len(seen.sigma_px), 2))
    # the mean square over 2 x 100 cells is known to sqrt(2 / 200)
    assert systematic_ratio(error, seen, SIZE) < np.sqrt(1 + 4 * np.sqrt(2 / (2 * CELLS**2)))


def test_a_common_error_counts_as_often_as_a_cell_has_observations(
    rng: np.random.Generator,
) -> None:
    seen = _observations(rng)
    error = np.full((len(seen.sigma_px), 2), 0.1)  # one sigma everywhere
    expected = np.sqrt(len(seen.sigma_px) / CELLS**2)
    assert systematic_ratio(error, seen, SIZE) == pytest.approx(expected, rel=0.01)


def test_one_misread_patch_is_not_systematic(rng: np.random.Generator) -> None:
    seen = _observations(rng)
    error = rng.normal(0, 0.1, (len(seen.sigma_px), 2))
    error[0] = 100.0  # a thousand sigmas; the 200 observations of its cell are sound
    assert systematic_ratio(error, seen, SIZE) < 1.3


def test_priors_follow_what_is_known() -> None:
    dome = SimulatedDome.build(1, projectors=1, cameras=2)
    modes = {"zenith": "fixed", "second": "prior"}
    problem = dome.problem({}, intrinsics=modes, radius_known=False)
    rig = dome.rig()
    layout, sigma = ParameterLayout.of(rig), prior_sigmas(problem, rig)
    assert np.isinf(sigma[layout.screen]).all()
    fixed, free = sigma[layout.cameras["zenith"]], sigma[layout.cameras["second"]]
    assert np.isinf(fixed[:6]).all() and not fixed[6:].any()
    assert np.isfinite(free[6:]).all() and free[6] == pytest.approx(
        0.005 * rig.cameras["second"].lens.focal[0]
    )


def test_a_prior_stays_where_venue_toml_has_it() -> None:
    """A solve that starts elsewhere, as its later stages do, is pulled back, not held where it starts."""
    dome = SimulatedDome.build(1, projectors=1, cameras=1)
    problem = dome.problem({}, intrinsics={"zenith": "prior"})
    lens = ParameterLayout.of(dome.rig()).cameras["zenith"].start + 6
    step = np.zeros(ParameterLayout.of(dome.rig()).count)
    step[lens : lens + 2] = 0.05 * problem.cameras["zenith"].lens.focal
    start = dome.rig().moved(step)
    away = prior_departures(problem, start) - prior_departures(problem, dome.rig())
    assert away == pytest.approx(step, abs=1e-9)
    free = prior_sigmas(problem, start)
    free[np.isinf(free)] = 0.0  # nothing observes the pose
    found = Adjustment(problem, {}, free).solve(start, robust=False)
    known = problem.cameras["zenith"].lens.focal
    assert found.cameras["zenith"].lens.focal == pytest.approx(
        known, rel=1e-3
    )  # marks pull by 0.03 %


def test_outliers_do_not_move_the_robust_solution() -> None:
    dome = SimulatedDome.build(3, projectors=2)
    seen = dome.observations(64)
    for some in seen.values():
        some.projector_px[::10] += dome.rng.uniform(-200, 200, some.projector_px[::10].shape)
    problem = dome.problem(seen)
    prior = prior_sigmas(problem, dome.rig())
    start = dome.rig().moved(np.where(prior > 0, 1e-4, 0))
    found = Adjustment(problem, seen, prior).solve(start, robust=True)
    step, layout = step_between(found, dome.rig()), ParameterLayout.of(found)
    for block in (*layout.cameras.values(), *layout.projectors.values()):
        assert np.abs(step[block][:6]).max() < 1e-3  # rad, m


def test_a_misfit_that_all_projectors_share_is_not_averaged_out() -> None:
    """Ratio 2 is a misfit of sqrt(3) sigmas; seen through three projectors it counts as one."""
    pairs = [("zenith", name) for name in "abc"]
    scales, coarser = (dict(zip(pairs, each, strict=True)) for each in ((1, 2, 2), (1, 2, 4)))
    found = _with_correlated_misfit(scales, coarser)
    assert list(found.values()) == pytest.approx([1.0, np.sqrt(10), 4.0])


def test_a_smooth_misfit_exceeds_the_noise_by_more_in_larger_cells(
    rng: np.random.Generator,
) -> None:
    seen = _observations(rng)
    noise = rng.normal(0, 0.1, (len(seen.sigma_px), 2))
    wave = 0.02 * np.sin(seen.projector_px / SIZE * 2 * np.pi)
    fine, coarse = (systematic_ratio(noise + wave, seen, SIZE, cells) for cells in (CELLS, 5))
    assert coarse**2 - 1 > 2 * (fine**2 - 1)
