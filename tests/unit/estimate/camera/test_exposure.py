"""Planned exposures reach their targets in simulated photographs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from noisy_photographs import BLACK_SHARE, LAW, LIT, SENSOR, SHAPE, photograph, scene
from numpy.typing import NDArray

from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.camera.exposure import (
    BLACK_SIGMAS,
    MAX_RATIO,
    TARGET_LEVEL,
    TARGET_SNR,
    direct_light,
    exposure_for_snr,
    lit_by_brightness,
    merged_snr,
    meter,
    plan_exposures,
    round_down_exposure,
)
from procam.estimate.camera.noise import NoiseLaw
from procam.maths.codes.phase import WaveDistortion, fit_waves, micro_waves
from procam.maths.statistics import robust_sigma

PANEL = (1280, 800)
Pair = tuple[NDArray[np.uint16], NDArray[np.uint16]]


@pytest.fixture
def taken(rng: np.random.Generator) -> Pair:
    """White at 0.05 s and black at 5 s."""
    white, _ = scene()
    return photograph(white, 0.05, rng), photograph(BLACK_SHARE * white, 5.0, rng)


def planned(pair: Pair, **more: object):  # type: ignore[no-untyped-def]
    return plan_exposures(*pair, exposures_s=(0.05, 5.0), sensor=SENSOR, panel=PANEL, **more)  # type: ignore[arg-type]


class TestPlan:
    def test_the_brightest_pixel_stays_just_below_saturation(
        self, taken: Pair, rng: np.random.Generator
    ) -> None:
        plan, (white, _) = planned(taken), scene()
        assert plan.exposure_s == pytest.approx(
            TARGET_LEVEL * SENSOR.full_scale / np.quantile(white[LIT], 0.999),
            rel=0.03,  # its measured peak includes noise
        )
        assert (photograph(white, plan.exposure_s, rng) == 2**SENSOR.bits - 1).mean() < 1e-3

    def test_snr_of_the_darkest_pixel_equals_that_of_photographs(
        self, taken: Pair, rng: np.random.Generator
    ) -> None:
        plan, (white, _) = planned(taken), scene()
        dark = white[LIT].min() * np.ones(40_000)
        shots = photograph(dark, plan.exposure_s, rng).astype(float) - SENSOR.black_level
        black = BLACK_SHARE * dark[0] * plan.exposure_s
        assert plan.snr == pytest.approx((shots.mean() - black) / shots.std(), rel=0.06)

    def test_one_exposure_where_it_suffices(self, taken: Pair) -> None:
        plan = planned(taken, noise=NoiseLaw(0.5, 0.01))
        assert plan.bracket_s == (plan.exposure_s,)
        assert plan.snr_bracket == plan.snr > TARGET_SNR

    @pytest.mark.parametrize("fall", [10.0, 150.0])
    def test_brackets_reach_the_wanted_ratio(self, fall: float, rng: np.random.Generator) -> None:
        white, direct = scene(fall=fall)
        haze = white - direct
        white = direct + 0.01 * haze
        pair = (photograph(white, 0.05, rng), photograph(BLACK_SHARE * white, 5.0, rng))
        plan = planned(pair, direct=direct * 0.05)
        steps = np.diff(np.log(plan.bracket_s))
        assert 2 <= len(plan.bracket_s) <= 3
        assert np.allclose(steps, steps[0], rtol=0.02)
        assert steps[0] <= np.log(MAX_RATIO) + 0.01
        assert plan.snr < TARGET_SNR <= plan.snr_bracket * 1.01

    def test_black_exceeds_read_noise(self, taken: Pair) -> None:
        plan, (white, direct) = planned(taken, noise=LAW), scene()
        light = BLACK_SHARE * white[direct > 0].mean() * plan.black_exposure_s
        assert light == pytest.approx(BLACK_SIGMAS * np.sqrt(LAW.floor), rel=0.03)

    def test_column_error_equals_that_of_fits(self, taken: Pair, rng: np.random.Generator) -> None:
        white, direct = scene()
        plan = planned(taken, noise=LAW, direct=direct * 0.05)
        inner = direct[22:138, 32:168] * plan.exposure_s
        level = 0.5 * white[22:138, 32:168] * plan.exposure_s * (1 + BLACK_SHARE)
        waves = micro_waves(PANEL)
        errors = []
        for _ in range(2):
            rows = rng.integers(0, inner.size, 4000)
            amplitude, offset = 0.5 * inner.ravel()[rows], level.ravel()[rows]
            x = rng.uniform(0, PANEL[0], rows.size)
            samples = offset[:, None] + amplitude[:, None] * np.cos(waves.angles(x))
            samples += rng.normal(0, 1, samples.shape) * np.sqrt(LAW.variance(samples))
            fit = fit_waves(samples, waves, WaveDistortion(), x)
            errors.append(fit.x - x)
        sigma = robust_sigma(np.concatenate(errors), 0.0)
        assert plan.column_sigma_px == pytest.approx(sigma, rel=0.1)
        assert plan.column_sigma_darkest_px > plan.column_sigma_px

    def test_saturated_white_is_refused_with_an_exposure_to_try(
        self, rng: np.random.Generator
    ) -> None:
        white, _ = scene(brightest=200_000.0)
        pair = (photograph(white, 0.05, rng), photograph(BLACK_SHARE * white, 5.0, rng))
        with pytest.raises(OutOfModelRange, match=r"try 0.0125 s"):
            planned(pair)
        assert meter(pair[0], 0.05, SENSOR) == 0.0125

    def test_nothing_lit_is_refused(self, rng: np.random.Generator) -> None:
        dark = photograph(np.zeros(SHAPE), 1.0, rng)
        with pytest.raises(NotEnoughData, match="only 0 pixels are lit"):
            planned((dark, dark))

    def test_colour_is_exposed_for_its_brightest_channel(self, taken: Pair) -> None:
        white, black = taken
        red = np.clip(white * 1.5, 0, 4095).astype(np.uint16)
        colour = planned((np.stack([red, white, white], -1), np.stack([black] * 3, -1)))
        alone = planned((red, black))
        assert colour.exposure_s == alone.exposure_s

    def test_metering_goes_to_the_target(self, rng: np.random.Generator) -> None:
        white, _ = scene(brightest=6_000.0)
        better_s = meter(photograph(white, 0.05, rng), 0.05, SENSOR)
        peak = np.quantile(photograph(white, better_s, rng), 0.999) - SENSOR.black_level
        assert peak == pytest.approx(TARGET_LEVEL * SENSOR.full_scale, rel=0.1)


class TestParts:
    @given(st.floats(1e-4, 900.0))
    def test_exposures_are_rounded_down(self, seconds: float) -> None:
        assert 0.99 * seconds <= round_down_exposure(seconds) <= seconds * (1 + 1e-12)

    @given(
        st.floats(1, 1e5), st.floats(0.05, 1), st.floats(0.1, 9), st.floats(0, 1), st.floats(1, 200)
    )
    def test_exposure_for_a_ratio_reaches_it(
        self, white: float, share: float, floor: float, per_level: float, snr: float
    ) -> None:
        law, pixel = NoiseLaw(floor, per_level), (white, share * white)
        assert merged_snr(pixel, law, [exposure_for_snr(pixel, law, snr)]) == pytest.approx(snr)

    def test_halves_separate_direct_from_scattered(self) -> None:
        _, direct = scene()
        haze = np.full(SHAPE, 0.4 * direct.max())
        side = np.arange(SHAPE[1]) < 100
        left, right = direct * side + haze / 2, direct * ~side + haze / 2
        found = direct_light(left, right, direct + haze, 1.0)
        assert np.allclose(found[found > 0], direct[found > 0])
        assert (found[direct == 0] == 0).all()

    def test_two_groups_are_split(self) -> None:
        white, direct = scene()
        assert np.array_equal(lit_by_brightness(white, 1.0), direct > 0)
        assert not lit_by_brightness(np.zeros(SHAPE), 1.0).any()
