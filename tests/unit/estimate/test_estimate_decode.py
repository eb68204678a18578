"""Gray codes back to projector pixels: real photographs first, then what each limit is for."""

from collections.abc import Iterator
from importlib import resources

import numpy as np
import pytest

from procam.errors import ShapeError
from procam.estimate.decode import (
    CodePair,
    DecodeLimits,
    decode_gray_pairs,
    default_limits,
    drop_outside,
)
from procam.maths.gray import bit_count, stripe
from procam.model.correspondence import CorrespondenceMap

REAL_PIXELS = 43_473


class Real:
    """The crop of kamino410's captures; its order is told in calib_data/captures/README.md."""

    def __init__(self) -> None:
        path = resources.files("calib_data") / "captures" / "kamino_pose3_crop.npz"
        with path.open("rb") as file, np.load(file) as data:
            self.images = data["images"].astype(np.float32)
            self.expected = np.stack([data["expected_x"], data["expected_y"]], axis=-1)
        self.valid = self.expected[..., 0] >= 0
        self.white, self.black = self.images[40], self.images[41]

    def pairs(self) -> Iterator[CodePair]:
        for first, axis in ((0, "x"), (20, "y")):
            for place in range(10):
                bright, inverse = self.images[first + 2 * place : first + 2 * place + 2]
                yield CodePair(axis, 9 - place, bright, inverse)

    def decoded(self, limits: DecodeLimits) -> CorrespondenceMap:
        bits = {"x": bit_count(1024), "y": bit_count(768)}
        found = decode_gray_pairs(self.pairs(), self.white, self.black, bits, limits)
        return drop_outside(found, (1024, 768))


@pytest.fixture(scope="module")
def real() -> Real:
    return Real()


class TestRealCaptures:
    def test_the_published_thresholds_give_the_published_map(self, real: Real) -> None:
        found = real.decoded(DecodeLimits(40, 5, 0))
        assert found.valid.sum() == REAL_PIXELS
        np.testing.assert_array_equal(found.valid, real.valid)
        np.testing.assert_array_equal(found.projector_xy[real.valid], real.expected[real.valid])

    def test_own_thresholds_keep_99_percent_and_agree(self, real: Real) -> None:
        found = real.decoded(default_limits(real.white, real.black))
        both = found.valid & real.valid
        assert both.sum() >= 0.99 * REAL_PIXELS
        np.testing.assert_array_equal(found.projector_xy[both], real.expected[both])

    def test_what_is_not_valid_is_unknown(self, real: Real) -> None:
        found = real.decoded(DecodeLimits(40, 5))
        assert np.isnan(found.projector_xy[~found.valid]).all()
        assert np.isnan(found.sigma_px[~found.valid]).all()
        # where in the pixel it is, a code cannot tell: a uniform distribution's sigma
        np.testing.assert_allclose(found.sigma_px[found.valid], 12**-0.5, rtol=1e-6)


SIZE = (20, 13)


def _pictures(light: np.ndarray, spill: float = 0.0) -> tuple[list[CodePair], np.ndarray]:
    """Pairs as a camera that sees the panel 1:1 would take them, and white; `spill` is light from
    elsewhere, half of it present in every code picture."""
    width, height = SIZE
    pairs = []
    for axis, length in (("x", width), ("y", height)):
        for bit in range(bit_count(length)):
            line = stripe(length, bit)
            plane = np.broadcast_to(line[None] if axis == "x" else line[:, None], (height, width))
            pairs.append(
                CodePair(
                    axis,
                    bit,
                    (light * plane + spill / 2).astype(np.float32),
                    (light * ~plane + spill / 2).astype(np.float32),
                )
            )
    return pairs, (light + spill).astype(np.float32)


BITS = {"x": bit_count(SIZE[0]), "y": bit_count(SIZE[1])}


def _decode(pairs: list[CodePair], white: np.ndarray, limits: DecodeLimits) -> CorrespondenceMap:
    return decode_gray_pairs(pairs, white, np.zeros_like(white), BITS, limits)


class TestSynthetic:
    width, height = SIZE
    truth = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)

    def test_any_order_of_the_pairs(self) -> None:
        pairs, white = _pictures(np.full((self.height, self.width), 0.4))
        for order in (pairs, pairs[::-1], pairs[::2] + pairs[1::2]):
            found = _decode(order, white, DecodeLimits(0.1, 0.1))
            assert found.valid.all()
            np.testing.assert_array_equal(found.projector_xy, self.truth)

    def test_dark_pixels_are_not_lit(self) -> None:
        light = np.ones((self.height, self.width))
        light[3, 4], light[5, 6] = 0.05, 0.0
        pairs, white = _pictures(light)
        found = _decode(pairs, white, DecodeLimits(0.1, 0.0, 0))
        assert sorted(np.argwhere(~found.valid).tolist()) == [[3, 4], [5, 6]]

    def test_one_weak_bit_is_enough_to_doubt(self) -> None:
        pairs, white = _pictures(np.ones((self.height, self.width)))
        pairs[3].bright[2, 2] = pairs[3].inverse[2, 2] + 0.01
        found = _decode(pairs, white, DecodeLimits(0.1, 0.1, 0))
        assert np.argwhere(~found.valid).tolist() == [[2, 2]]

    def test_light_from_elsewhere_on_the_dome_is_not_lit(self) -> None:
        """White - black is large all over a dome; the contrast of the coarse bits is not."""
        light = np.ones((self.height, self.width))
        light[:, 12:] = 0.1
        pairs, white = _pictures(light, spill=0.4)
        trap = _decode(pairs, white, DecodeLimits(0.2, 0.05, 0))
        assert trap.valid.all()
        found = _decode(pairs, white, DecodeLimits(0.2, 0.05, 0.5))
        np.testing.assert_array_equal(found.valid, light == 1)

    @pytest.mark.parametrize("where", ["white", "pattern"])
    def test_saturated_pixels_are_unknown(self, where: str) -> None:
        pairs, white = _pictures(np.ones((self.height, self.width)))
        (white if where == "white" else pairs[1].bright)[4, 5] = np.nan
        found = _decode(pairs, white, DecodeLimits(0.1, 0.1))
        assert np.argwhere(~found.valid).tolist() == [[4, 5]]

    def test_pictures_of_different_shapes_are_refused(self) -> None:
        pairs, white = _pictures(np.ones((self.height, self.width)))
        with pytest.raises(ShapeError, match=r"code x0: got shape \(13, 20\), expected \(13, 19\)"):
            _decode(pairs, white[:, :-1], DecodeLimits(0.1, 0.1))

    def test_codes_beyond_the_panel_are_misread(self) -> None:
        pairs, white = _pictures(np.ones((self.height, self.width)))
        found = drop_outside(_decode(pairs, white, DecodeLimits(0.1, 0.1)), (18, 13))
        np.testing.assert_array_equal(found.valid, self.truth[..., 0] < 18)
        assert np.isnan(found.projector_xy[~found.valid]).all()
        assert np.isnan(found.sigma_px[~found.valid]).all()


class TestDefaultLimits:
    @pytest.mark.parametrize("sigma", [2.0, 20.0])
    def test_follow_the_noise(self, rng: np.random.Generator, sigma: float) -> None:
        black = rng.normal(100, sigma, (300, 300)).round()
        limits = default_limits(black + 1000, black)
        # quantised to whole counts, the median of differences is one of them
        assert limits.contrast == pytest.approx(4 * sigma, abs=4 * 1.4826 / 2**0.5)
        assert limits.white_black == pytest.approx(2 * limits.contrast)

    def test_a_noise_free_picture_is_limited_by_its_steps(self) -> None:
        black = np.tile([10.0, 10.0, 10.0, 11.0], (8, 8)) / 255
        assert default_limits(black + 0.5, black).contrast == pytest.approx(2 / 255)
