"""The closed loop on patches against dense solves and closed forms."""

import numpy as np
import pytest
from tolerances import SOLVER

from procam.errors import OutOfModelRange
from procam.estimate.closed_loop.patches import (
    MAX_PHOTOGRAPHS,
    MIN_PHOTOGRAPHS,
    LoopObservation,
    LoopState,
    common_errors,
    converged,
    just_noticeable,
    largest_regression,
    photographs_needed,
    posterior,
    residual_jnd,
    residual_without_noise,
)
from procam.estimate.closed_loop.scatter import PatchScatter, remove_scatter
from studies import loop as study

Array = np.ndarray
PATCHES = 240


@pytest.fixture
def sphere(rng: np.random.Generator) -> tuple[Array, Array]:
    """Albedo and area of the patches of a unit sphere."""
    area = rng.uniform(0.5, 1.5, PATCHES)
    return rng.uniform(0.2, 0.7, PATCHES), area * 4 * np.pi / area.sum()


def _dense(albedo: Array, area: Array) -> Array:
    """N by inverting, F_ij = a_j / A_s."""
    return np.linalg.inv(np.eye(len(area)) - albedo[:, None] * area / (4 * np.pi))


def _scatter(albedo: Array, area: Array) -> Array:
    return albedo / (4 * np.pi - area @ albedo)


class TestJustNoticeable:
    def test_weber_fractions(self) -> None:
        light = np.array([14.0, 10.0, 1.0, 0.1]) / 14.0
        shares = just_noticeable(light) / light
        np.testing.assert_allclose(shares, [0.007, 0.007, np.sqrt(0.007 * 0.04), 0.04])

    def test_constant_below_a_tenth_of_a_nit(self) -> None:
        np.testing.assert_allclose(just_noticeable(np.array([0.0, 0.1 / 14])), 0.004 / 14)


class TestRemoveScatter:
    def test_closed_form_on_a_sphere(
        self, sphere: tuple[Array, Array], rng: np.random.Generator
    ) -> None:
        """dx_F = r_F - rho_F (a_F.r_F) / (A_s - sum of a rho over what is not free)."""
        albedo, area = sphere
        free, change = rng.random(PATCHES) < 0.6, rng.normal(size=PATCHES)
        step = remove_scatter(change, free, _scatter(*sphere)[:, None], area[:, None])
        rest = 4 * np.pi - (area * albedo)[~free].sum()
        wanted = change - albedo * (area * change)[free].sum() / rest
        np.testing.assert_allclose(step[free], wanted[free], atol=SOLVER)

    def test_of_several_moments(self, rng: np.random.Generator) -> None:
        spread, collect = rng.normal(size=(2, PATCHES, 4)) / PATCHES
        free, change = rng.random(PATCHES) < 0.5, rng.normal(size=PATCHES)
        step = remove_scatter(change, free, spread, collect)
        seen = (np.eye(PATCHES) + spread @ collect.T) @ step
        np.testing.assert_allclose(seen[free], change[free], atol=SOLVER)


class TestStep:
    def test_reaches_the_best_within_the_limits(
        self, sphere: tuple[Array, Array], rng: np.random.Generator
    ) -> None:
        """Conditions of optimality: exact where free, pulled outwards where held."""
        state = _state(sphere)
        goal, asked = rng.uniform(0, 0.8, (PATCHES, 1)), np.full((PATCHES, 1), 0.2)
        down, up = asked - 0.01, 0.35 - asked
        asked = asked + state.step(asked, goal, down, up)
        wrong = goal[:, 0] - _dense(*sphere) @ asked[:, 0]
        low, high = asked[:, 0] < 0.01 + 1e-9, asked[:, 0] > 0.35 - 1e-9
        assert low.any() and high.any() and (~low & ~high).any()
        assert np.abs(wrong[~low & ~high]).max() < SOLVER
        assert (wrong[low] < SOLVER).all() and (wrong[high] > -SOLVER).all()

    def test_a_held_patch_is_released_when_it_needs_light(
        self, sphere: tuple[Array, Array]
    ) -> None:
        state = _state(sphere)
        asked = np.full((PATCHES, 1), 0.01)
        held = state.step(asked, np.full_like(asked, 0.0), asked - 0.01, 1 - asked)
        free = state.step(asked, np.full_like(asked, 0.5), asked - 0.01, 1 - asked)
        assert not held.any() and (free > 0.05).all()


class TestLearn:
    def test_two_full_steps_then_equal_weight_of_every_photograph(
        self, sphere: tuple[Array, Array]
    ) -> None:
        state = _state(sphere)
        asked = np.full((PATCHES, 1), 0.5)
        ripple = np.resize([0.01, -0.01], (PATCHES, 1))  # nothing of it is common
        shares = []
        for _ in range(5):
            before = state.surplus.copy()
            state.learn(_observation(asked, state.expected(asked) + ripple, 4))
            shares.append(np.abs(state.surplus - before).mean() / 0.01)
        np.testing.assert_allclose(shares, [1, 1, 1 / 2, 1 / 3, 1 / 4], rtol=0.02)

    def test_unknown_patches_have_no_effect(self, sphere: tuple[Array, Array]) -> None:
        state = _state(sphere)
        asked = np.full((PATCHES, 1), 0.5)
        seen = state.expected(asked)
        seen[:10] = 99.0
        known = np.arange(PATCHES)[:, None] >= 10
        state.learn(LoopObservation(asked, seen, np.full_like(asked, 0.001), known, 1))
        assert np.abs(state.surplus).max() < SOLVER and state.scatter_factor[0] == 1

    @pytest.mark.parametrize("factor", [0.9, 1.1])
    def test_one_observation_separates_scatter_from_gains(
        self, sphere: tuple[Array, Array], rng: np.random.Generator, factor: float
    ) -> None:
        state = _state(sphere, factor)
        asked = np.resize([0.01, 0.3, 0.6], (PATCHES, 1))
        gain = 1 + 0.02 * rng.normal(size=(PATCHES, 1))
        state.learn(_observation(asked, _dense(*sphere) @ (gain * asked), 1))
        assert state.scatter_factor[0] * factor == pytest.approx(1, abs=0.02)
        got = (asked + state.surplus) / asked
        np.testing.assert_allclose(got[1::3], gain[1::3], atol=0.01)


class TestCommonErrors:
    def test_estimates_and_their_errors(self, rng: np.random.Generator) -> None:
        light, scattered = rng.uniform(0.2, 1, (2, 5000))
        residual = 0.03 * light - 0.05 * scattered + 0.01 * rng.normal(size=5000)
        found, covariance = common_errors(
            residual, light, scattered, np.full(5000, 1e4), np.arange(5000) // 100
        )
        sigma = np.sqrt(np.diag(covariance))
        assert (sigma < 0.001).all()
        assert (np.abs(found - [0.03, -0.05]) < 4 * sigma).all()

    def test_errors_are_as_large_as_stated(self) -> None:
        """Mean squared z over 200 rigs whose gains share an error within each of 25 blocks."""
        light, scattered = np.random.default_rng(7).uniform(0.2, 1, (2, 1000))
        block, scores = np.arange(1000) // 40, []
        for seed in range(200):
            rng = np.random.default_rng(seed)
            gain = 0.02 * rng.normal(size=25)[block] + 0.02 * rng.normal(size=1000)
            found, covariance = common_errors(
                gain * light, light, scattered, np.full(1000, 1e4), block
            )
            scores.append(found**2 / np.diag(covariance))
        # Student's t of some 24 degrees of freedom has a variance of 1.09; 4 sigmas of the mean
        assert np.mean(scores) == pytest.approx(1.09, abs=0.4)

    def test_only_a_significant_change_of_scatter_is_applied(self) -> None:
        small, clear = np.array([0.02, 0.01]), np.array([0.02, 0.1])
        covariance = np.diag([1e-8, 1e-8])
        assert posterior(small, covariance, 0.002) == pytest.approx((0.02, 0), rel=1e-3)
        assert posterior(clear, covariance, 0.002) == pytest.approx((0.02, 0.1), rel=1e-3)
        assert posterior(clear, covariance, 0.05)[1] == 0

    def test_without_light_the_prior_remains(self) -> None:
        dark = np.zeros(50)
        found, covariance = common_errors(dark, dark, dark, dark, np.zeros(50, int))
        assert posterior(found, covariance, 0.01) == (0, 0)


class TestRules:
    def test_photographs_are_as_many_as_a_jnd_needs(self) -> None:
        light = np.full(100, 1.0)  # its JND is 0.7 % of white
        for sigma, wanted in ((0.0, MIN_PHOTOGRAPHS), (0.009, 7), (0.02, MAX_PHOTOGRAPHS)):
            assert photographs_needed(np.full(100, sigma), light) == wanted

    def test_a_camera_that_cannot_resolve_is_refused(self) -> None:
        with pytest.raises(
            OutOfModelRange,
            match=r"closed loop: one photograph is uncertain by 14 JND in half of the dome; it needs at "
            r"most 8, so open the aperture",
        ):
            photographs_needed(np.full(100, 0.05), np.full(100, 1.0))

    def test_residual_without_noise(self) -> None:
        residual, sigma = np.array([0.05, -0.05]), np.full(2, 0.06)
        assert residual_without_noise(residual, sigma, 4) == pytest.approx(0.04)
        assert residual_without_noise(residual, sigma, 1) == 0

    def test_stops_at_half_a_jnd_in_almost_all_patches(self) -> None:
        light, sigma = np.ones(1000), np.zeros(1000)
        residual = np.where(np.arange(1000) < 40, 0.1, 0.0034)
        assert residual_jnd(residual, light) == pytest.approx(0.0034 / 0.007)
        assert converged(residual, sigma, light, 1)
        assert not converged(1.1 * residual, sigma, light, 1)

    def test_stops_at_the_noise_of_eight_photographs(self) -> None:
        light, sigma = np.ones(1000), np.full(1000, 0.02)
        noise = 0.01  # of the mean of four
        for left, stops in ((0.9, True), (1.1, False)):
            residual = np.full(1000, np.hypot(noise, left * 0.02 / np.sqrt(8)))
            assert converged(residual, sigma, light, 4) is stops


class TestRegression:
    def test_the_worst_neighbourhood_is_found(self) -> None:
        block = np.repeat([0, 1, 2], 100)
        first, judged = np.full((300, 2), 0.3), np.ones((300, 2), bool)
        last = first.copy()
        last[100:200, 1] = 1.9
        last[200:, 0] = 1.7
        found = largest_regression(first, last, np.full((300, 2), 0.1), judged, block)
        assert found is not None
        np.testing.assert_array_equal(found.place, block == 1)
        assert (found.channel, found.before) == (1, pytest.approx(np.sqrt(0.08)))
        assert found.after == pytest.approx(np.sqrt(3.6))

    def test_noise_invisible_changes_and_unjudged_patches_are_no_regression(
        self, rng: np.random.Generator
    ) -> None:
        block, judged = np.repeat([0, 1], 100), np.ones((200, 1), bool)
        noise = np.full((200, 1), 2.0)
        first, last = 2.0 * rng.normal(size=(2, 200, 1))
        assert largest_regression(first, last, noise, judged, block) is None
        quiet = np.zeros((200, 1))
        assert largest_regression(quiet, quiet + 0.9, quiet, judged, block) is None
        judged[20:] = False
        assert largest_regression(quiet, quiet + 9, quiet, judged, block) is None


class TestLoops:
    """A small version of studies/loop.md: dense transport, gains 5 % and scatter 10 % wrong."""

    @pytest.mark.parametrize(("kappa", "seed"), [(0.25, 0), (0.55, 0), (0.55, 1)])
    def test_three_corrections_and_the_noise_of_six(self, kappa: float, seed: int) -> None:
        row = study.study(study.Plant(kappa, seed, 16, 40))
        needed = study.iterations_to(row["jnd"]["procam"])
        assert needed is not None and needed <= 3
        assert row["single_sigmas"][study.AVERAGING] <= 0.55
        if (kappa, seed) == (0.55, 0):  # of seed 1 noise hides the growth so far
            diverging = row["jnd"]["plain, g = 1, no limits"]
            assert diverging[-1] > 1.1 * diverging[-3] > 1.2 * diverging[-5]
            assert study.iterations_to(row["jnd"]["plain, g = 1"]) is None
            assert study.iterations_to(row["jnd"]["preconditioned, clipped"]) is None


def _state(sphere: tuple[Array, Array], factor: float = 1.0) -> LoopState:
    scatter = PatchScatter(factor * _scatter(*sphere)[None, :, None], sphere[1][:, None])
    return LoopState(scatter, np.arange(PATCHES) // 20, np.array([0.005]))


def _observation(asked: Array, seen: Array, photographs: int) -> LoopObservation:
    sigma = np.full_like(asked, 0.001)
    return LoopObservation(asked, seen, sigma, np.ones_like(asked, bool), photographs)
