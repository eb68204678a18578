"""The noise law of photographs with known noise."""

import numpy as np
import pytest
from noisy_photographs import LAW, SENSOR, photograph

from procam.estimate.camera.noise import (
    NoiseLaw,
    fit_noise_law,
    noise_from_neighbours,
    noise_from_pairs,
    noise_from_repeat,
)


@pytest.mark.parametrize("law", [LAW, NoiseLaw(9.0, 0.02), NoiseLaw(1.0, 1.0)])
def test_noise_of_counts(law: NoiseLaw, rng: np.random.Generator) -> None:
    rate = 3000 * np.linspace(0, 1, 300)[:, None] ** 3 * np.ones(400)
    first, second = (photograph(rate, 1.0, rng, law) for _ in range(2))
    for found in (
        noise_from_neighbours([first], SENSOR),
        noise_from_repeat(first, second, SENSOR),
    ):
        for level in (0.0, 300.0, 3000.0):
            assert found.variance(level) == pytest.approx(law.variance(level) + 1 / 12, rel=0.15)


@pytest.mark.parametrize("law", [LAW, NoiseLaw(9.0, 0.02)], ids=str)
def test_noise_of_stripes_and_their_inverses(law: NoiseLaw, rng: np.random.Generator) -> None:
    light = 3000 * np.linspace(0, 1, 300)[:, None] ** 2 * np.ones(400)
    x = np.arange(400)
    masks = [on for bit in (4, 5) for on in ((x >> bit) & 1, 1 - ((x >> bit) & 1))]
    found = noise_from_pairs([photograph(light * on, 1.0, rng, law) for on in masks], SENSOR)
    for level in (0.0, 300.0, 3000.0):
        assert found.variance(level) == pytest.approx(law.variance(level) + 1 / 12, rel=0.15)


def test_counts_decoded_from_eight_bits_keep_their_steps() -> None:
    codes = np.rint(255 * np.linspace(0.1, 0.9, 120_000) ** (1 / 2.2))
    counts = np.rint(SENSOR.black_level + SENSOR.full_scale * (codes / 255) ** 2.2)
    dark = np.full(counts.shape, SENSOR.black_level)
    found = noise_from_pairs([counts, dark, dark, counts], SENSOR)
    bright = SENSOR.full_scale * 0.8
    step = bright * 2.2 / (255 * 0.8 ** (1 / 2.2))
    assert found.variance(bright) == pytest.approx(2 * step**2 / 12, rel=0.4)


def test_counts_without_noise_are_rounded() -> None:
    counts = np.full((300, 400), 500, np.uint16)
    found = noise_from_repeat(counts, counts, SENSOR)
    assert 1 / 12 <= found.variance(500.0) < 0.25


def test_photographs_that_are_all_saturated_have_that_of_rounding() -> None:
    white = np.full(400, 2**SENSOR.bits - 1, np.uint16)
    assert 0 < noise_from_pairs([white] * 4, SENSOR).variance(3000.0) <= 1 / 12


def test_a_change_of_brightness_is_no_noise(rng: np.random.Generator) -> None:
    rate = np.linspace(100, 3000, 300 * 400).reshape(300, 400)
    pair = photograph(rate, 1.0, rng), photograph(rate, 1.1, rng)
    found = noise_from_repeat(*pair, SENSOR)
    assert found.variance(2000.0) == pytest.approx(LAW.variance(2000.0), rel=0.15)


@pytest.mark.parametrize("law", [NoiseLaw(4.0, 0.0), NoiseLaw(0.0, 0.05), LAW], ids=str)
def test_law_from_variances(law: NoiseLaw, rng: np.random.Generator) -> None:
    level = rng.uniform(50, 400, 20_000)
    found = fit_noise_law(level, law.variance(level) * rng.chisquare(5, level.size) / 5)
    for at in (100.0, 350.0):
        assert found.variance(at) == pytest.approx(law.variance(at), rel=0.05)
    assert found.floor >= 0 and found.per_level >= 0


@pytest.mark.parametrize("pixels", [60, 144, 1000, 40_000])
def test_a_law_of_few_pixels_is_not_too_small(pixels: int, rng: np.random.Generator) -> None:
    """Groups of few samples have small variances by chance; they must not decide."""
    level = rng.uniform(10, 200, pixels)
    ratios = []
    for _ in range(40):
        variance = (2 + 0.05 * level) * rng.chisquare(5, pixels) / 5
        law = fit_noise_law(level, variance)
        ratios.append(float(np.mean(law.variance(level)) / np.mean(2 + 0.05 * level)))
    assert 0.95 < np.mean(ratios) < 1.05
