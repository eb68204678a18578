"""Sampling, blurring and shrinking pictures."""

import numpy as np
import pytest
from tolerances import FLOAT32, SAMPLE_PX

from procam.maths.warp import (
    block_mean,
    blur,
    blur_within,
    edge_distance,
    grow,
    local_median,
    sample,
)


@pytest.fixture
def ramp() -> np.ndarray:
    """10 x + y at (x, y): bilinear sampling is exact on it."""
    y, x = np.mgrid[0:8, 0:12]
    return (10.0 * x + y).astype(np.float32)


class TestSample:
    def test_pixel_centres_and_fractions(self, ramp: np.ndarray) -> None:
        xy = np.array([[0.0, 0.0], [11.0, 7.0], [3.25, 2.5], [0.5, 6.75]])
        found = sample(ramp, xy)
        np.testing.assert_allclose(found, xy @ [10, 1], atol=11 * SAMPLE_PX)

    @pytest.mark.parametrize("channels", [1, 2, 5])
    def test_exact_with_any_number_of_channels(
        self, ramp: np.ndarray, channels: int, rng: np.random.Generator
    ) -> None:
        """OpenCV itself rounds positions to 1/32 px for 2 channels and for more than 4."""
        factors = np.arange(1, channels + 1)
        xy = rng.uniform([0, 0], [11, 7], (400, 2))
        found = sample(ramp[..., None] * factors, xy)
        assert found.shape == (400, channels)
        np.testing.assert_allclose(
            found / factors, (xy @ [10, 1])[:, None] + 0 * factors, atol=1e-3
        )

    def test_two_channels_are_those_of_one(self, rng: np.random.Generator) -> None:
        image = rng.random((9, 13, 2)).astype(np.float32)
        xy = rng.uniform(-2, 14, (6, 7, 2))
        found = sample(image, xy, outside=np.nan)
        for i in range(2):
            np.testing.assert_array_equal(found[..., i], sample(image[..., i], xy, outside=np.nan))

    @pytest.mark.parametrize("place", [[np.nan, np.nan], [-2.0, 3.0], [3.0, 99.0], [1e9, -1e9]])
    @pytest.mark.parametrize("outside", [0.0, 7.5])
    def test_outside_and_unknown_places(
        self, ramp: np.ndarray, place: list[float], outside: float
    ) -> None:
        image = np.repeat(ramp[..., None] + 100, 3, axis=-1)
        found = sample(image, np.array([place, [2.0, 2.0]]), outside)
        np.testing.assert_array_equal(found[0], np.full(3, outside, np.float32))
        np.testing.assert_allclose(found[1], 122.0, atol=1e-3)

    def test_a_half_unknown_position_is_unknown(self, ramp: np.ndarray) -> None:
        assert sample(ramp + 5, np.array([[2.0, np.nan]])).tolist() == [0.0]


class TestBlur:
    def test_keeps_the_sum_and_the_level(self, rng: np.random.Generator) -> None:
        image = np.zeros((41, 41), np.float32)
        image[20, 20] = 1
        spread = blur(image, 2.0)
        assert spread.sum() == pytest.approx(1, abs=FLOAT32)
        x = np.arange(-20, 21)
        assert (spread * x**2).sum() == pytest.approx(4.0, rel=0.01)  # variance sigma^2
        np.testing.assert_allclose(blur(np.full((9, 9, 3), 0.7), 3.0), 0.7, rtol=FLOAT32)

    def test_within_a_mask_nothing_leaks_in(self) -> None:
        image = np.full((30, 30, 3), 50.0, np.float32)
        mask = np.zeros((30, 30), bool)
        mask[5:15, 5:15] = True
        image[mask] = 2.0
        found = blur_within(image, mask, 1.5)
        np.testing.assert_allclose(found[4:16, 4:16], 2.0, rtol=FLOAT32)
        assert not found[25:, 25:].any()

    def test_unknown_values_outside_the_mask_do_no_harm(self) -> None:
        image = np.full((12, 12), np.nan, np.float32)
        mask = np.zeros((12, 12), bool)
        mask[3:9, 3:9] = True
        image[mask] = 1.0
        assert np.isfinite(blur_within(image, mask, 1.0)).all()


class TestMasks:
    def test_grow_is_a_disc_and_shrink_undoes_it(self) -> None:
        mask = np.zeros((31, 31), bool)
        mask[15, 15] = True
        disc = grow(mask, 5)
        y, x = np.mgrid[-15:16, -15:16]
        assert disc[15, 10] and disc[15, 20] and disc[10, 15] and not disc[15, 9]
        assert (disc <= (np.hypot(x, y) < 5.5)).all()
        square = np.zeros((31, 31), bool)
        square[8:20, 8:20] = True
        np.testing.assert_array_equal(grow(grow(square, 3), -3), square)

    def test_shrinking_starts_at_the_border_of_the_image_too(self) -> None:
        left = grow(np.ones((10, 10), bool), -2)
        assert left.sum() == 36 and left[2:8, 2:8].all()

    def test_edge_distance_counts_the_border_as_outside(self) -> None:
        found = edge_distance(np.ones((7, 9), bool))
        y, x = np.mgrid[0:7, 0:9]
        expected = np.minimum.reduce([x + 1, 9 - x, y + 1, 7 - y])
        np.testing.assert_allclose(found, expected, atol=FLOAT32)
        assert not edge_distance(np.zeros((3, 3), bool)).any()


class TestBlockMean:
    def test_is_the_mean_of_each_block(self, rng: np.random.Generator) -> None:
        image = rng.random((16, 24, 3)).astype(np.float32)
        expected = image.reshape(2, 8, 3, 8, 3).mean(axis=(1, 3))
        np.testing.assert_allclose(block_mean(image, 8), expected, rtol=FLOAT32)

    def test_a_ragged_edge_is_left_out(self) -> None:
        image = np.ones((17, 25), np.float32)
        image[16:], image[:, 24:] = 1e6, 1e6
        np.testing.assert_array_equal(block_mean(image, 8), np.ones((2, 3)))


class TestLocalMedian:
    def test_is_the_median_of_five_by_five(self, rng: np.random.Generator) -> None:
        image = rng.normal(0, 1, (20, 30)).astype(np.float32)
        found = local_median(image, np.ones(image.shape, bool))
        windows = np.lib.stride_tricks.sliding_window_view(image, (5, 5))
        expected = np.median(windows, axis=(2, 3))
        np.testing.assert_array_equal(found[2:-2, 2:-2], expected)

    def test_unknown_pixels_shift_it_by_one_rank_at_most(self, rng: np.random.Generator) -> None:
        image = rng.normal(0, 1, (40, 50)).astype(np.float32)
        mask = rng.random(image.shape) < 0.6
        found = local_median(np.where(mask, image, np.nan), mask)
        for row in range(2, 38):
            for column in range(2, 48):
                part = np.s_[row - 2 : row + 3, column - 2 : column + 3]
                known = np.sort(image[part][mask[part]])
                place = np.searchsorted(known, found[row, column])
                # 25 samples of which those unknown lie half above, half below
                above = np.add.outer(np.arange(row - 2, row + 3), np.arange(column - 2, column + 3))
                low = int(((above % 2 == 0) & ~mask[part]).sum())
                assert place == np.clip(12 - low, 0, len(known))
