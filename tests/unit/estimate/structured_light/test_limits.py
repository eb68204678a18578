"""Default limits of a decoder, and the samples they drop."""

import numpy as np
import pytest

from procam.estimate.structured_light.limits import DecodeLimits, default_limits, dropped_samples


@pytest.mark.parametrize("sigma", [2.0, 20.0])
def test_follow_the_noise(rng: np.random.Generator, sigma: float) -> None:
    black = rng.normal(100, sigma, (300, 300)).round()
    limits = default_limits(black + 1000, black)
    # quantised to whole counts, the median of differences is one of them
    assert limits.contrast == pytest.approx(4 * sigma, abs=4 * 1.4826 / 2**0.5)
    assert limits.white_black == pytest.approx(2 * limits.contrast)
    assert (limits.saturated, limits.dark) == (None, None)


def test_a_noise_free_picture_is_limited_by_its_steps() -> None:
    black = np.tile([10.0, 10.0, 10.0, 11.0], (8, 8)) / 255
    assert default_limits(black + 0.5, black).contrast == pytest.approx(2 / 255)


@pytest.mark.parametrize(
    ("top", "full"), [(200, 255), (255, 255), (256, 1023), (4000, 4095), (20_000, 65_535)]
)
def test_whole_numbers_end_at_their_full_scale(top: int, full: int) -> None:
    white = np.full((8, 8), top, np.uint16)
    limits = default_limits(white, np.zeros_like(white))
    assert (limits.saturated, limits.dark) == (full, 0)


def test_saturated_dark_and_missing_samples_are_dropped() -> None:
    limits = DecodeLimits(1.0, 1.0, saturated=255, dark=0.0)
    whole = np.array([[0, 1, 254, 255]], np.uint8)
    assert dropped_samples(whole, limits).tolist() == [[True, False, False, True]]
    merged = np.array([[np.nan, -1.0, 0.5, np.inf]], np.float32)
    expected = [[True, False, False, True]]
    assert dropped_samples(merged, DecodeLimits(1.0, 1.0)).tolist() == expected
