"""Statistics of paired comparisons against closed forms, and against what they promise, by simulation."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_1samp
from tolerances import CLOSED_FORM, SIGMAS

from studies.preference.statistics import (
    POWER,
    holm,
    jod,
    observers_needed,
    power,
    preference,
    sign_test,
)

RUNS = 4000


def within(found: float, expected: float) -> bool:
    """Whether a share of `RUNS` runs is what was promised, but for chance."""
    return abs(found - expected) < SIGMAS * math.sqrt(expected * (1 - expected) / RUNS)


class TestPreference:
    def test_the_interval_of_three_by_hand(self) -> None:
        """Mean 0.6, sigma 0.1; with 2 degrees of freedom P(|T| > x) = 1 - x / sqrt(2 + x^2)."""
        found = preference(np.array([0.5, 0.6, 0.7]))
        half = 0.95 * math.sqrt(2 / (1 - 0.95**2)) * 0.1 / math.sqrt(3)
        assert (found.observers, found.first, found.second) == (3, 2, 0)
        assert found.share == pytest.approx(0.6, abs=CLOSED_FORM)
        assert found.sigma == pytest.approx(0.1, abs=CLOSED_FORM)
        assert found.low == pytest.approx(0.6 - half, abs=CLOSED_FORM)
        assert found.high == pytest.approx(0.6 + half, abs=CLOSED_FORM)
        x = 0.1 / (0.1 / math.sqrt(3))
        assert found.p_value == pytest.approx(1 - x / math.sqrt(2 + x**2), abs=CLOSED_FORM)

    def test_the_p_value_is_that_of_a_t_test(self, rng: np.random.Generator) -> None:
        shares = rng.integers(0, 9, 11) / 8
        expected = ttest_1samp(shares, 0.5)
        found = preference(shares)
        interval = expected.confidence_interval(0.95)
        assert found.p_value == pytest.approx(expected.pvalue)
        assert (found.low, found.high) == pytest.approx((interval.low, interval.high))

    @pytest.mark.parametrize("shares", [[0.7], [0.8, 0.8, 0.8], [1.0, 1.0]])
    def test_without_a_spread_only_the_sign_test_remains(self, shares: list[float]) -> None:
        found = preference(np.array(shares))
        assert np.isnan([found.low, found.high, found.p_value]).all()
        assert found.sign_p == 2 * 0.5 ** len(shares)
        assert observers_needed(found.share, found.sigma) is None

    def test_an_interval_ends_where_shares_do(self) -> None:
        found = preference(np.array([0.9, 1.0, 0.8]))
        assert (found.high, found.jod_high) == (1.0, math.inf)
        assert found.reversed.low == 0.0

    def test_reversed_is_that_of_the_other(self) -> None:
        shares = np.array([0.25, 0.5, 0.75, 1.0, 0.875])
        found, other = preference(shares).reversed, preference(1 - shares)
        for name in ("share", "sigma", "low", "high", "p_value", "sign_p", "jod", "jod_low"):
            assert getattr(found, name) == pytest.approx(getattr(other, name)), name
        assert (found.first, found.second) == (other.first, other.second)

    def test_the_interval_covers_and_the_test_is_right_one_time_in_twenty(
        self, rng: np.random.Generator
    ) -> None:
        """12 people with a share of their own about one half, 20 choices each: what a test is like."""
        own = rng.beta(6, 6, (RUNS, 12))
        found = [preference(row) for row in rng.binomial(20, own) / 20]
        assert within(np.mean([f.low <= 0.5 <= f.high for f in found]), 0.95)
        assert within(np.mean([f.p_value < 0.05 for f in found]), 0.05)

    def test_choices_of_one_person_do_not_count_as_people(self, rng: np.random.Generator) -> None:
        """6 people who differ: a test over their 600 choices would find a preference most of the time."""
        own = rng.beta(1, 1, (RUNS, 6))
        shares = rng.binomial(100, own) / 100
        naive = np.abs(shares.mean(1) - 0.5) / (0.5 / math.sqrt(600)) > 1.96
        assert naive.mean() > 0.5
        assert np.mean([preference(row).p_value < 0.05 for row in shares]) < 0.08


class TestSigns:
    @pytest.mark.parametrize(
        ("first", "second", "p_value"),
        [(0, 0, 1.0), (1, 0, 1.0), (5, 0, 2 / 32), (4, 1, 12 / 32), (3, 3, 1.0), (0, 6, 2 / 64)],
    )
    def test_coins_by_hand(self, first: int, second: int, p_value: float) -> None:
        assert sign_test(first, second) == pytest.approx(p_value, abs=CLOSED_FORM)

    def test_who_prefers_neither_does_not_count(self) -> None:
        found = preference(np.array([0.5, 0.5, 1.0, 0.75, 0.25]))
        assert (found.first, found.second, found.sign_p) == (2, 1, 1.0)


class TestDistance:
    def test_three_quarters_are_one_jod(self) -> None:
        assert jod(0.75) == 1.0
        assert jod(0.5) == 0.0
        assert jod(0.25) == pytest.approx(-1.0, abs=CLOSED_FORM)

    def test_distances_add(self, rng: np.random.Generator) -> None:
        """Of three qualities on a line, as Thurstone has them; one JOD is sigma sqrt(2) Phi^-1(0.75)."""
        quality = np.array([0.0, 0.4, 1.1])
        seen = quality[:, None] + rng.normal(0, 1, (3, 400_000))
        near, far, both = (np.mean(seen[b] > seen[a]) for a, b in ((0, 1), (1, 2), (0, 2)))
        assert jod(near) + jod(far) == pytest.approx(jod(both), abs=0.02)
        assert jod(both) == pytest.approx(1.1 / (math.sqrt(2) * 0.67449), abs=0.02)

    def test_unanimous_is_beyond_measure(self) -> None:
        assert (jod(1.0), jod(0.0)) == (math.inf, -math.inf)


class TestPower:
    @pytest.mark.parametrize(
        ("observers", "share", "sigma"), [(5, 0.7, 0.15), (12, 0.6, 0.2), (30, 0.42, 0.15)]
    )
    def test_so_many_tests_find_it(
        self, observers: int, share: float, sigma: float, rng: np.random.Generator
    ) -> None:
        shares = rng.normal(share, sigma, (RUNS, observers))
        found = np.mean([preference(row).p_value < 0.05 for row in shares])
        assert within(found, power(observers, share, sigma))

    def test_without_a_difference_it_is_the_false_alarms(self) -> None:
        assert power(9, 0.5, 0.2) == pytest.approx(0.05, abs=1e-6)

    def test_both_tails_count(self) -> None:
        """Two people with a share near one half are misled as often as not."""
        one_sided = 0.025
        assert power(2, 0.5 + 1e-6, 0.2) == pytest.approx(2 * one_sided, abs=1e-4)

    @pytest.mark.parametrize("sigma", [0.05, 0.13, 0.3])
    @pytest.mark.parametrize("share", [0.55, 0.6, 0.75, 0.25, 0.999])
    def test_the_number_needed_is_the_first_that_is_enough(
        self, share: float, sigma: float
    ) -> None:
        needed = observers_needed(share, sigma)
        assert needed is not None and needed >= 2
        assert power(needed, share, sigma) >= POWER
        assert needed == 2 or power(needed - 1, share, sigma) < POWER
        assert needed == observers_needed(1 - share, sigma)

    def test_more_are_needed_than_a_normal_distribution_says(self) -> None:
        """By about two, for small samples: (1.96 + 0.8416)^2 (sigma / difference)^2."""
        normal = (1.959964 + 0.841621) ** 2 * (0.2 / 0.1) ** 2
        assert normal < 32
        assert observers_needed(0.6, 0.2) == 34

    @pytest.mark.parametrize(
        ("share", "sigma"), [(0.5, 0.2), (0.6, 0.0), (0.6, math.nan), (0.5 + 1e-6, 0.4)]
    )
    def test_no_number_is_enough(self, share: float, sigma: float) -> None:
        assert observers_needed(share, sigma) is None

    def test_a_certain_difference_is_certain(self) -> None:
        """From a distance of 8 on SciPy's far tail is NaN now and then."""
        assert all(
            power(count, share, 0.02) == pytest.approx(1, abs=1e-9)
            for count in (20, 21, 22, 30, 500)
            for share in (0.6, 0.9)
        )


class TestHolm:
    def test_by_hand(self) -> None:
        found = holm([0.04, 0.01, 0.02])
        assert found == pytest.approx([0.04, 0.03, 0.04], abs=CLOSED_FORM)
        assert holm([0.9, 0.8]) == [1.0, 1.0]
        assert holm([0.03]) == [0.03]
        assert holm([]) == []

    def test_false_findings_stay_rare(self, rng: np.random.Generator) -> None:
        p_values = rng.random((RUNS, 6))
        found = np.mean([min(holm(list(row))) < 0.05 for row in p_values])
        assert within(found, 1 - (1 - 0.05 / 6) ** 6)
