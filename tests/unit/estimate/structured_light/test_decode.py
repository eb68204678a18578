"""Photographs of a code to projector pixels: real photographs, then the effect of each limit."""

from importlib import resources

import numpy as np
import pytest

from procam.errors import InputError, NotEnoughData, ShapeError
from procam.estimate.structured_light.codes import Code, generate, make_code
from procam.estimate.structured_light.decode import Decoded, Decoder
from procam.estimate.structured_light.limits import DecodeLimits

REAL_PIXELS = 43_473
PUBLISHED = DecodeLimits(40, 5, lit_share=0, neighbours=False)


class Real:
    """The crop of kamino410's captures; its order is in calib_data/captures/README.md."""

    code = make_code("gray", (1024, 768))

    def __init__(self) -> None:
        path = resources.files("calib_data") / "captures" / "kamino_pose3_crop.npz"
        with path.open("rb") as file, np.load(file) as data:
            images = data["images"]
            self.expected = np.stack([data["expected_x"], data["expected_y"]], axis=-1)
        self.valid = self.expected[..., 0] >= 0
        self.frames = [images[40], images[41], *images[:40]]

    def decoded(
        self, limits: DecodeLimits | None, *, without: int = 0, dtype: type = np.uint8
    ) -> Decoded:
        decoder = Decoder(self.code, limits)
        for number, frame in enumerate(self.frames):
            if not without or number != without:
                decoder.add(number, frame.astype(dtype))
        return decoder.result()


@pytest.fixture(scope="module")
def real() -> Real:
    return Real()


class TestRealCaptures:
    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
    def test_the_published_thresholds_give_the_published_map(self, real: Real, dtype: type) -> None:
        decoded = real.decoded(PUBLISHED, dtype=dtype)
        found = decoded.map
        assert decoded.notes == ()
        assert found.valid.sum() == REAL_PIXELS
        np.testing.assert_array_equal(found.valid, real.valid)
        np.testing.assert_array_equal(found.projector_xy[real.valid], real.expected[real.valid])

    def test_own_thresholds_keep_99_percent_and_agree(self, real: Real) -> None:
        found = real.decoded(None).map
        both = found.valid & real.valid
        assert both.sum() >= 0.99 * REAL_PIXELS
        np.testing.assert_array_equal(found.projector_xy[both], real.expected[both])

    @pytest.mark.parametrize("number", [2, 21, 23, 40])
    def test_a_missing_photograph_is_computed_from_white_black_and_its_partner(
        self, real: Real, number: int
    ) -> None:
        found = real.decoded(PUBLISHED, without=number).map
        both = found.valid & real.valid
        # real pictures of pattern and inverse do not quite add up to white and black
        assert both.sum() >= 0.97 * REAL_PIXELS
        wrong = (found.projector_xy[both] != real.expected[both]).any(axis=1)
        assert wrong.mean() < 1e-3
        assert np.abs(found.projector_xy[both] - real.expected[both]).max() <= 1


SIZE = (20, 13)
GRAY = make_code("gray", SIZE)
PLAIN = DecodeLimits(0.1, 0.1, lit_share=0, neighbours=False)
DOME = DecodeLimits(0.2, 0.05, lit_share=0.5, neighbours=False)
TRUTH = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1)


def _photographs(light: np.ndarray, spill: float = 0.0) -> list[np.ndarray]:
    """What a camera that sees the panel 1:1 would take; `spill` is light from elsewhere in white,
    half of it present in every code picture."""
    shown = [picture[..., 0] / 255 for picture in generate(GRAY)]
    share = [1.0, 0.0, *[0.5] * (len(shown) - 2)]
    return [
        (light * p + spill * part).astype(np.float32) for p, part in zip(shown, share, strict=True)
    ]


def _decode(
    frames: list[np.ndarray], limits: DecodeLimits, order: list[int] | None = None
) -> Decoded:
    decoder = Decoder(GRAY, limits)
    for number in [0, 1, *(order or range(2, len(frames)))]:
        decoder.add(number, frames[number])
    return decoder.result()


def _ones() -> np.ndarray:
    return np.ones((SIZE[1], SIZE[0]))


class TestSynthetic:
    def test_any_order_of_the_pairs(self) -> None:
        frames = _photographs(0.4 * _ones())
        pairs = [[i, i + 1] for i in range(2, len(frames), 2)]
        swapped = [[b, a] for a, b in pairs]
        for order in (pairs, pairs[::-1], pairs[::2] + pairs[1::2], swapped):
            found = _decode(frames, PLAIN, [i for pair in order for i in pair]).map
            assert found.valid.all()
            np.testing.assert_array_equal(found.projector_xy, TRUTH)

    def test_a_pair_without_contrast_is_reported_and_left_out(self) -> None:
        frames = _photographs(_ones())
        i = GRAY.planes.index(next(p for p in GRAY.planes if p.axis == "y" and p.bit == 0))
        frames[i] = frames[i + 1] = 0.5 * frames[0]
        decoded = _decode(frames, PLAIN)
        assert decoded.notes == ("nothing could be read from row bit 0 inverse",)
        np.testing.assert_array_equal(decoded.map.projector_xy[..., 0], TRUTH[..., 0])
        # the thirteenth row has no partner: nothing but itself has its codeword
        rows = np.minimum(TRUTH[..., 1] // 2 * 2 + 0.5, 12)
        np.testing.assert_array_equal(decoded.map.projector_xy[..., 1], rows)

    def test_dark_pixels_are_not_lit(self) -> None:
        light = _ones()
        light[3, 4], light[5, 6] = 0.05, 0.0
        found = _decode(
            _photographs(light), DecodeLimits(0.1, 0.0, lit_share=0, neighbours=False)
        ).map
        assert sorted(np.argwhere(~found.valid).tolist()) == [[3, 4], [5, 6]]

    def test_light_from_elsewhere_on_the_dome_is_not_lit(self) -> None:
        """White - black is large all over a dome; the contrast of the coarse bits is not."""
        light = _ones()
        light[:, 12:] = 0.1
        frames = _photographs(light, spill=0.4)
        trap = _decode(frames, DecodeLimits(0.2, 0.05, lit_share=0, neighbours=False)).map
        assert trap.valid.all()
        decoded = _decode(frames, DOME)
        np.testing.assert_array_equal(decoded.map.valid, light == 1)

    @pytest.mark.parametrize("number", [0, 5], ids=["white", "pattern"])
    def test_samples_that_are_not_numbers_are_unknown(self, number: int) -> None:
        frames = _photographs(_ones())
        frames[number][4, 5] = np.nan
        found = _decode(frames, PLAIN).map
        assert np.argwhere(~found.valid).tolist() == [[4, 5]]

    def test_pictures_of_different_shapes_are_refused(self) -> None:
        frames = _photographs(_ones())
        decoder = Decoder(GRAY, PLAIN)
        decoder.add(0, frames[0])
        with pytest.raises(ShapeError, match=r"photograph 1 has shape \(13, 19\)"):
            decoder.add(1, frames[1][:, :-1])
        decoder.add(1, frames[1])
        with pytest.raises(ShapeError, match=r"photograph 7 has shape \(12, 20\)"):
            decoder.add(7, frames[7][1:])

    def test_white_and_black_come_first_and_once(self) -> None:
        frames = _photographs(_ones())
        for numbers in ([1], [0, 0], [2], [0, 2], [0, 1, 0], [0, 1, 1]):
            decoder = Decoder(GRAY, PLAIN)
            for number in numbers[:-1]:
                decoder.add(number, frames[number])
            with pytest.raises(InputError, match=f"photograph {numbers[-1]} came too early or"):
                decoder.add(numbers[-1], frames[numbers[-1]])

    def test_nothing_to_decode(self) -> None:
        decoder = Decoder(GRAY, PLAIN)
        decoder.add(0, _photographs(_ones())[0])
        with pytest.raises(NotEnoughData, match="white and black are missing"):
            decoder.result()

    def test_codewords_beyond_the_panel_are_unknown(self) -> None:
        narrow = make_code("gray", (18, 13))
        assert len(narrow.planes) == len(GRAY.planes)
        decoder = Decoder(narrow, PLAIN)
        for number, frame in enumerate(_photographs(_ones())):
            decoder.add(number, frame)
        found = decoder.result().map
        np.testing.assert_array_equal(found.valid, TRUTH[..., 0] < 18)
        assert np.isnan(found.projector_xy[~found.valid]).all()
        assert np.isnan(found.sigma_px[~found.valid]).all()

    def test_a_misread_pixel_is_dropped_where_neighbours_must_agree(self) -> None:
        frames = _photographs(_ones())
        coarse = GRAY.planes.index(next(p for p in GRAY.planes if p.axis == "x" and p.bit == 3))
        for number in (coarse, coarse + 1):
            frames[number][6, 2] = 1 - frames[number][6, 2]
        assert _decode(frames, PLAIN).map.valid.all()
        found = _decode(frames, DecodeLimits(0.1, 0.1, lit_share=0)).map
        assert np.argwhere(~found.valid).tolist() == [[6, 2]]


class TestSaturation:
    """Clipped samples are no longer sinusoidal: the decoder leaves them out and reports it."""

    code = make_code("micro-phase", (240, 150))

    def _frames(self, code: Code, gain: float) -> list[np.ndarray]:
        rng = np.random.default_rng(8)
        frames = []
        for picture in generate(code):
            light = (picture[..., 0] / 255.0) ** 2.2
            signal = 40 + gain * 200 * light + rng.normal(0, 0.5, light.shape)
            frames.append(np.clip(np.rint(signal), 0, 255).astype(np.uint8))
        return frames

    def test_clipped_whites_are_reported_and_clipped_samples_left_out(self) -> None:
        rows, columns = np.mgrid[:150, :240]
        decoder = Decoder(self.code)
        for number, frame in enumerate(self._frames(self.code, 1.2)):
            decoder.add(number, frame)
        decoded = decoder.result()
        assert decoded.notes == ("white is saturated in 100% of the lit pixels",)
        found = decoded.map
        assert found.valid.mean() > 0.9
        miss = found.projector_xy - np.stack([columns, rows], -1)
        assert np.abs(miss[found.valid]).max() < 1
        z = (miss / found.sigma_px)[found.valid]
        assert np.mean(z**2) < 1.5

    def test_a_fine_exposure_needs_no_note(self) -> None:
        decoder = Decoder(self.code)
        for number, frame in enumerate(self._frames(self.code, 1.0)):
            decoder.add(number, frame)
        assert decoder.result().notes == ()
