"""Exposures planned from one pair do what they promise; merged exposures are unbiased and honest."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tolerances import SIGMAS

from procam.errors import InputError, NotEnoughData, OutOfModelRange, ShapeError
from procam.estimate.camera.checks import (
    additivity,
    brightness_ratio,
    fit_dark_frames,
    grey_gamma,
    response_exponent,
)
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
from procam.estimate.camera.hdr import merge_exposures
from procam.estimate.camera.noise import NoiseLaw, noise_from_neighbours, noise_from_repeat
from procam.estimate.structured_light.codes import generate, make_code
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.limits import DecodeLimits
from procam.maths.codes.phase import WaveDistortion, fit_waves, micro_waves
from procam.model.correspondence import CorrespondenceMap
from procam.model.optics import Sensor

SENSOR = Sensor(bits=12, black_level=64.0)
LAW = NoiseLaw(floor=2.25, per_level=0.3)
PANEL = (1280, 800)
SHAPE = (160, 200)
LIT = (slice(20, 140), slice(30, 170))
BLACK_SHARE = 1 / 1500
ROWS = 40  # of the panel: enough to look at

Array = NDArray[np.float64]


def photograph(
    rate: Array, exposure_s: float, rng: np.random.Generator, law: NoiseLaw = LAW
) -> NDArray[np.uint16]:
    """Counts [DN] of rates [DN/s]."""
    signal = rate * exposure_s
    noisy = signal + rng.normal(0, 1, rate.shape) * np.sqrt(law.variance(signal))
    return np.rint(np.clip(noisy + SENSOR.black_level, 0, 2**SENSOR.bits - 1)).astype(np.uint16)


def scene(brightest: float = 30_000.0, fall: float = 4.0) -> tuple[Array, Array]:
    """Rates (H, W) of white and of its direct part: a slope that falls `fall`-fold, and a haze."""
    direct = np.zeros(SHAPE)
    width = LIT[1].stop - LIT[1].start
    direct[LIT] = brightest * np.linspace(1, 1 / fall, width)
    return direct + 0.1 * direct.mean(), direct


@pytest.fixture
def taken(rng: np.random.Generator) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
    """White at .05 s and black at 5 s."""
    white, _ = scene()
    return photograph(white, 0.05, rng), photograph(BLACK_SHARE * white, 5.0, rng)


def planned(pair: tuple[NDArray[np.uint16], NDArray[np.uint16]], **more: object):  # type: ignore[no-untyped-def]
    return plan_exposures(*pair, exposures_s=(0.05, 5.0), sensor=SENSOR, panel=PANEL, **more)  # type: ignore[arg-type]


class TestPlan:
    def test_exposure_brings_the_brightest_just_below_saturation(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]], rng: np.random.Generator
    ) -> None:
        plan, (white, _) = planned(taken), scene()
        assert plan.exposure_s == pytest.approx(
            TARGET_LEVEL * SENSOR.full_scale / np.quantile(white[LIT], 0.999),
            rel=0.03,  # what it meters holds noise
        )
        assert (photograph(white, plan.exposure_s, rng) == 2**SENSOR.bits - 1).mean() < 1e-3

    def test_the_lit_share_is_told_from_the_pair_alone(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]]
    ) -> None:
        _, direct = scene()
        assert planned(taken).lit_share == pytest.approx((direct > 0).mean(), rel=0.01)

    def test_ratio_of_the_darkest_is_what_photographs_show(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]], rng: np.random.Generator
    ) -> None:
        plan, (white, _) = planned(taken), scene()
        dark = white[LIT].min() * np.ones(40_000)
        shots = photograph(dark, plan.exposure_s, rng).astype(float) - SENSOR.black_level
        black = BLACK_SHARE * dark[0] * plan.exposure_s
        assert plan.snr == pytest.approx((shots.mean() - black) / shots.std(), rel=0.06)

    def test_one_exposure_where_it_is_enough(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]]
    ) -> None:
        plan = planned(taken, noise=NoiseLaw(0.5, 0.01))
        assert plan.bracket_s == (plan.exposure_s,)
        assert plan.snr_bracket == plan.snr > TARGET_SNR

    @pytest.mark.parametrize("fall", [10.0, 40.0, 150.0])
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

    def test_black_stands_clear_of_read_noise(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]]
    ) -> None:
        plan, (white, direct) = planned(taken, noise=LAW), scene()
        light = BLACK_SHARE * white[direct > 0].mean() * plan.black_exposure_s
        assert light == pytest.approx(BLACK_SIGMAS * np.sqrt(LAW.floor), rel=0.03)

    def test_column_error_is_what_a_fit_of_noisy_samples_has(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]], rng: np.random.Generator
    ) -> None:
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
            fit = fit_waves(samples, np.ones(samples.shape, bool), waves, WaveDistortion(), x)
            errors.append(fit.x - x)
        sigma = 1.4826 * np.median(np.abs(np.concatenate(errors)))
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
        with pytest.raises(NotEnoughData, match="lit pixels, expected at least"):
            planned((dark, dark))

    def test_colour_is_exposed_for_its_brightest_channel(
        self, taken: tuple[NDArray[np.uint16], NDArray[np.uint16]]
    ) -> None:
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

    def test_halves_tell_direct_from_scattered(self) -> None:
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

    @pytest.mark.parametrize("law", [LAW, NoiseLaw(9.0, 0.02), NoiseLaw(1.0, 1.0)])
    def test_noise_is_read_off_pictures(self, law: NoiseLaw, rng: np.random.Generator) -> None:
        rate = 3000 * np.linspace(0, 1, 300)[:, None] ** 3 * np.ones(400)
        first, second = (photograph(rate, 1.0, rng, law) for _ in range(2))
        for found in (
            noise_from_neighbours([first], SENSOR),
            noise_from_repeat(first, second, SENSOR),
        ):
            for level in (0.0, 300.0, 3000.0):
                assert found.variance(level) == pytest.approx(
                    law.variance(level) + 1 / 12, rel=0.15
                )

    def test_a_brighter_repeat_is_no_noise(self, rng: np.random.Generator) -> None:
        rate = np.linspace(100, 3000, 300 * 400).reshape(300, 400)
        pair = photograph(rate, 1.0, rng), photograph(rate, 1.1, rng)
        found = noise_from_repeat(*pair, SENSOR)
        assert found.variance(2000.0) == pytest.approx(LAW.variance(2000.0), rel=0.15)


class TestMerge:
    EXPOSURES = (0.02, 0.08, 0.32)

    def merged(self, rate: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        shots = [photograph(rate, e, rng) for e in self.EXPOSURES]
        radiance, variance = merge_exposures(shots, self.EXPOSURES, sensor=SENSOR, noise=LAW)
        assert radiance.dtype == variance.dtype == np.float32
        return radiance * SENSOR.full_scale, variance * SENSOR.full_scale**2

    # faint; half full in the longest; clipped in the longest; clipped in the two longer
    @pytest.mark.parametrize("rate", [50.0, 6000.0, 16_000.0, 30_000.0, 90_000.0])
    def test_unbiased_and_honest_at_every_level(
        self, rate: float, rng: np.random.Generator
    ) -> None:
        truth = np.full((200, 200), rate)
        law = replace(LAW, floor=LAW.floor + 1 / 12)
        shots = [photograph(truth, e, rng) for e in self.EXPOSURES]
        radiance, variance = merge_exposures(shots, self.EXPOSURES, sensor=SENSOR, noise=law)
        error = radiance.astype(float) * SENSOR.full_scale - rate
        expected = variance.astype(float).mean() * SENSOR.full_scale**2
        assert abs(error.mean()) < SIGMAS * np.sqrt(expected / error.size)
        # chi2 over its freedom, with four of its own sigmas
        chi2 = np.mean(error**2) / expected
        assert chi2 == pytest.approx(1, abs=SIGMAS * np.sqrt(2 / error.size))

    def test_more_exposures_help(self, rng: np.random.Generator) -> None:
        truth = np.full((50, 50), 1000.0)
        _, variance = self.merged(truth, rng)
        alone = LAW.variance(1000 * self.EXPOSURES[-1]) / self.EXPOSURES[-1] ** 2
        assert (variance < alone).all()

    def test_what_saturates_in_all_is_unknown(self, rng: np.random.Generator) -> None:
        truth = np.full((4, 5), 100.0)
        truth[1, 2] = 1e6
        radiance, variance = self.merged(truth, rng)
        lost = truth == 1e6
        assert np.array_equal(np.isnan(radiance), lost)
        assert np.array_equal(np.isnan(variance), lost)

    def test_order_does_not_matter(self, rng: np.random.Generator) -> None:
        truth = rng.uniform(10, 80_000, (30, 30))
        shots = [photograph(truth, e, rng) for e in self.EXPOSURES]
        ahead = merge_exposures(shots, self.EXPOSURES, sensor=SENSOR, noise=LAW)
        back = merge_exposures(shots[::-1], self.EXPOSURES[::-1], sensor=SENSOR, noise=LAW)
        assert all(np.array_equal(a, b) for a, b in zip(ahead, back, strict=True))

    def test_one_exposure_is_itself(self, rng: np.random.Generator) -> None:
        shot = photograph(np.full((8, 8), 2000.0), 0.5, rng)
        radiance, variance = merge_exposures([shot], [0.5], sensor=SENSOR, noise=LAW)
        signal = shot - SENSOR.black_level
        assert np.allclose(radiance, signal / (0.5 * SENSOR.full_scale))
        expected = LAW.variance(signal) / (0.5 * SENSOR.full_scale) ** 2
        assert np.allclose(variance, expected)

    def test_pictures_that_do_not_belong_together(self) -> None:
        flat = np.full((4, 4), 100, np.uint16)
        with pytest.raises(InputError, match="each with its positive exposure"):
            merge_exposures([flat], [0.1, 0.2], sensor=SENSOR, noise=LAW)
        with pytest.raises(ShapeError, match="exposure 1"):
            merge_exposures([flat, flat[:2]], [0.1, 0.2], sensor=SENSOR, noise=LAW)

    @pytest.mark.parametrize("share", [0.93, 0.97, 0.99, 1.0, 1.01, 1.05])
    def test_where_noise_decides_over_clipping_little_bias_is_left(
        self, share: float, rng: np.random.Generator
    ) -> None:
        rate = share * SENSOR.full_scale / self.EXPOSURES[-1]
        radiance, variance = self.merged(np.full((200, 200), rate), rng)
        assert abs(radiance.mean() - rate) < 0.1 * np.sqrt(variance.max())

    def test_merged_codes_decode_where_no_single_exposure_does(
        self, rng: np.random.Generator
    ) -> None:
        code = make_code("micro-phase", (240, 150))
        gain = 20_000.0 * np.linspace(0.07, 1, 240) ** 2  # 200 to 1 across the panel
        rates = [gain * ((p[:ROWS, :, 0] / 255) ** 2.2 + BLACK_SHARE) for p in generate(code)]
        exposures = (0.15, 1.2)

        def alone(exposure_s: float) -> CorrespondenceMap:
            decoder = Decoder(code, DecodeLimits(6.0, 6.0, saturated=4095))
            for number, rate in enumerate(rates):
                decoder.add(number, photograph(rate, exposure_s, rng))
            return decoder.result().map

        decoder = Decoder(code, DecodeLimits(white_black=0.002, contrast=0.002))
        for number, rate in enumerate(rates):
            shots = [photograph(rate, e, rng) for e in exposures]
            merged = merge_exposures(shots, exposures, sensor=SENSOR, noise=LAW)
            decoder.add(number, *merged)
        whole = decoder.result().map
        assert whole.valid.mean() > 0.97
        assert whole.valid.mean() > max(alone(e).valid.mean() for e in exposures)
        inner = whole.valid[:, 5:-5]
        error = (whole.projector_xy[..., 0] - np.arange(240)) / whole.sigma_px[..., 0]
        # two exposures' variances are of the mean level, not of each sample's own
        assert 0.7 < np.mean(error[:, 5:-5][inner] ** 2) < 1.4

    def test_decoder_takes_merged_pictures_and_their_holes(self, rng: np.random.Generator) -> None:
        code = make_code("micro-phase", (240, 150))
        gain = np.full(240, 20_000.0)
        gain[-10:] = 1e7  # a glint
        decoder = Decoder(code, DecodeLimits(white_black=0.05, contrast=0.02))
        for number, picture in enumerate(generate(code)):
            rate = gain * ((picture[:ROWS, :, 0] / 255) ** 2.2 + BLACK_SHARE)
            shots = [photograph(rate, e, rng) for e in (0.1, 0.15)]
            decoder.add(number, merge_exposures(shots, (0.1, 0.15), sensor=SENSOR, noise=LAW)[0])
        found = decoder.result().map
        assert found.valid[:, 2:225].mean() > 0.95
        assert not found.valid[:, -8:].any()


class TestDeviceChecks:
    def test_the_dark_line_starts_at_the_black_level(self, rng: np.random.Generator) -> None:
        room = np.full((60, 80), 12.0)
        room[:3, :3] = 900.0  # an exit sign
        shots = [photograph(room, e, rng) for e in (0.1, 2.0)]
        level, ambient = fit_dark_frames(shots[0], shots[1], (0.1, 2.0))
        assert level == pytest.approx(SENSOR.black_level, abs=0.15)
        assert np.median(ambient) == pytest.approx(12.0, rel=0.1)

    @given(st.floats(0.2, 1.5), st.floats(1.5, 8))
    def test_exponent(self, exponent: float, ratio: float) -> None:
        light = np.linspace(10, 100, 50)
        found = response_exponent(
            (ratio * light) ** exponent, light**exponent, ratio, np.ones(50, bool)
        )
        assert found == pytest.approx(exponent)

    def test_halves_add_up_with_black_in_each(self) -> None:
        white, direct = scene()
        black = BLACK_SHARE * white
        side = np.arange(SHAPE[1]) < 100
        haze = (white - direct) / 2
        halves = (direct * side + haze + black, direct * ~side + haze + black)
        assert additivity(halves, white + black, black, direct > 0) == pytest.approx(1)
        dimmed = (0.8 * halves[0], 0.8 * halves[1])
        assert additivity(dimmed, white + black, black, direct > 0) == pytest.approx(0.8, abs=0.01)

    @given(st.floats(0.9, 3))
    def test_gamma_from_one_grey(self, gamma: float) -> None:
        white, direct = scene()
        black = BLACK_SHARE * white
        grey = black + (white - black) * 0.5**gamma
        assert grey_gamma(grey, white, black, direct > 0, 0.5) == pytest.approx(gamma)

    def test_brightness(self) -> None:
        white, direct = scene()
        assert brightness_ratio(white, 1.3 * white, direct > 0) == pytest.approx(1.3)
