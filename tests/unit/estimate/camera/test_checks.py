"""Checks of a camera and a projector on simulated photographs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from noisy_photographs import BLACK_SHARE, SENSOR, SHAPE, photograph, scene

from procam.estimate.camera.checks import (
    additivity,
    early_clipping,
    exposure_ratio,
    fit_dark_frames,
    grey_gamma,
    response_exponent,
)


def test_dark_frames_give_the_black_level(rng: np.random.Generator) -> None:
    room = np.full((60, 80), 12.0)
    room[:3, :3] = 900.0  # an exit sign
    shots = [photograph(room, e, rng) for e in (0.1, 2.0)]
    level, ambient = fit_dark_frames(shots[0], shots[1], (0.1, 2.0))
    assert level == pytest.approx(SENSOR.black_level, abs=0.15)
    assert np.median(ambient) == pytest.approx(12.0, rel=0.1)


@given(st.floats(0.2, 1.5), st.floats(1.5, 8))
def test_exponent(exponent: float, ratio: float) -> None:
    light = np.linspace(10, 100, 50)
    found = response_exponent(
        (ratio * light) ** exponent, light**exponent, ratio, np.ones(50, bool)
    )
    assert found == pytest.approx(exponent)


def test_halves_add_up_with_black_in_each() -> None:
    white, direct = scene()
    black = BLACK_SHARE * white
    side = np.arange(SHAPE[1]) < 100
    haze = (white - direct) / 2
    halves = (direct * side + haze + black, direct * ~side + haze + black)
    assert additivity(halves, white + black, black, direct > 0) == pytest.approx(1)
    dimmed = (0.8 * halves[0], 0.8 * halves[1])
    assert additivity(dimmed, white + black, black, direct > 0) == pytest.approx(0.8, abs=0.01)


@given(st.floats(0.9, 3))
def test_gamma_from_one_grey(gamma: float) -> None:
    white, direct = scene()
    black = BLACK_SHARE * white
    grey = black + (white - black) * 0.5**gamma
    assert grey_gamma(grey, white, black, direct > 0, 0.5) == pytest.approx(gamma)


class TestEarlyClipping:
    """White on a dome, brighter in the middle, by sensors of several depths and noise."""

    def white(self, rng: np.random.Generator, bits: int, snr: float, peak: float) -> np.ndarray:
        y, x = np.mgrid[-1:1:300j, -1:1:400j]
        light = peak * (1 - 0.4 * (x**2 + y**2) / 2)
        light = light + rng.normal(0, 1 / snr, light.shape) * np.sqrt(light)
        return np.clip(np.rint(light * (2**bits - 1)), 0, 2**bits - 1).astype(np.uint16)

    @pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
    @pytest.mark.parametrize("snr", [30.0, 100.0, 1e6])
    def test_an_end_below_full_scale(self, rng: np.random.Generator, bits: int, snr: float) -> None:
        sound = self.white(rng, bits, snr, 0.8)
        full = 2**bits - 1
        assert early_clipping(sound, full) is None
        level = int(np.quantile(sound, 0.9))
        found = early_clipping(np.minimum(sound, level), full)
        assert found is not None and found[0] == level
        assert found[1] == pytest.approx((sound >= level).mean(), abs=0.01)
        colour = np.dstack([sound, np.minimum(sound, level), sound])
        assert early_clipping(colour, full) == found

    def test_pixels_that_saturate_at_slightly_different_levels(
        self, rng: np.random.Generator
    ) -> None:
        """Within 0.03 % of each other, as by different black levels; half of white is clipped."""
        sound = self.white(rng, 14, 100, 0.8)
        ends = np.median(sound) * (1 + rng.normal(0, 3e-4, sound.shape))
        clipped = np.minimum(sound, np.rint(ends)).astype(np.uint16)
        found = early_clipping(clipped, 2**14 - 1)
        assert found is not None and found[1] > 0.3

    def test_full_scale_itself_and_dark_pictures_are_no_early_end(
        self, rng: np.random.Generator
    ) -> None:
        assert early_clipping(self.white(rng, 12, 100, 1.5), 4095) is None
        assert early_clipping(np.minimum(self.white(rng, 12, 100, 0.3), 500), 4095) is None

    def test_few_alike_pixels_are_specks(self, rng: np.random.Generator) -> None:
        picture = self.white(rng, 12, 100, 0.5)
        picture[:7, :7] = 3000
        assert early_clipping(picture, 4095) is None


class TestExposureRatio:
    """A dim picture, lit on one half, photographed at both exposures."""

    def photographs(self, rng: np.random.Generator, ratio: float) -> list[np.ndarray]:
        light = np.where(np.arange(80) < 40, 20.0, 2.0) * np.ones((60, 1))
        short = light + rng.normal(0, 5, light.shape) + 1.5  # black's level drifted
        return [short, ratio * light + rng.normal(0, 0.2, light.shape)]

    @pytest.mark.parametrize("ratio", [0.4, 0.95, 1.0, 2.0])
    def test_the_ratio_and_its_error(self, rng: np.random.Generator, ratio: float) -> None:
        found = np.array([exposure_ratio(*self.photographs(rng, ratio)) for _ in range(200)])
        z = (found[:, 0] - ratio) / found[:, 1] / ratio
        assert abs(z.mean()) < 4 / np.sqrt(len(z))
        assert 0.8 < z.std() < 1.2
        assert found[:, 1].max() < 0.02

    def test_noise_of_the_longer_photograph_is_not_chosen(self, rng: np.random.Generator) -> None:
        light = np.where(np.arange(80) < 40, 20.0, 2.0) * np.ones((60, 1))
        z = []
        for _ in range(200):
            short, long = (light + rng.normal(0, noise, light.shape) for noise in (20, 8))
            ratio, sigma = exposure_ratio(short, long)
            z.append((ratio - 1) / sigma)
        assert abs(np.mean(z)) < 4 / np.sqrt(len(z)) and 0.8 < np.std(z) < 1.2

    @pytest.mark.parametrize("noise", [0.0, 0.2, 0.4, 1.0])
    def test_rounding_is_in_the_error(self, rng: np.random.Generator, noise: float) -> None:
        z = []
        for _ in range(300):
            bright, dark = rng.uniform([30, 1], [31, 3])
            light = np.where(np.arange(200) < 100, bright, dark) * np.ones((100, 1))
            short = np.rint(light + noise * rng.standard_normal(light.shape))
            ratio, sigma = exposure_ratio(short, light, step=1.0)
            z.append((ratio - 1) / sigma)
        assert np.std(z) < 1.3 and np.abs(z).max() < 5

    def test_pictures_that_do_not_tell(self) -> None:
        flat = np.ones((50, 50))
        lit = np.where(np.arange(50) < 25, 9.0, 1.0) * flat
        for short, long in (flat, flat), (np.nan * flat, flat), (0 * flat, lit), (-lit, lit):
            assert np.isnan(exposure_ratio(short, long)).all()
