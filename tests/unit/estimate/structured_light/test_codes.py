"""The structured-light codes: their pictures, and perfect photographs of them decoded again."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from procam.errors import InputError, NotEnoughData
from procam.estimate.structured_light.codes import (
    CODES,
    DEFAULT_CODE,
    AxisCode,
    Code,
    Plane,
    generate,
    make_code,
    picture,
    wave_code,
)
from procam.estimate.structured_light.decode import Decoded, Decoder
from procam.maths.codes.gray import bit_count
from procam.maths.codes.phase import Waves, equal_steps
from procam.model.correspondence import CorrespondenceMap

SIZE = (320, 200)
WAVES = [name for name in CODES if make_code(name, SIZE).has_waves]
STRIPES = [name for name in CODES if name not in WAVES]
SIZES = [(16, 9), (33, 31), (64, 64), (37, 101)]


def photographs(code: Code, whole: bool) -> list[np.ndarray]:
    """The panel seen 1:1 in linear light, as float32 or as counts of 8 bits over some room light."""
    light = [((p[..., 0] / 255.0) ** 2.2).astype(np.float32) for p in generate(code)]
    return [np.rint(20 + 200 * p).astype(np.uint8) for p in light] if whole else light


def decoded(code: Code, frames: list[np.ndarray]) -> Decoded:
    decoder = Decoder(code)
    for number, frame in enumerate(frames):
        decoder.add(number, frame)
    return decoder.result()


def truth(size: tuple[int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1)


def check_every_pixel(found: CorrespondenceMap, code: Code) -> None:
    assert found.valid.all()
    if code.has_waves:
        assert np.abs(found.projector_xy - truth(code.size)).max() < 0.1
    else:
        np.testing.assert_array_equal(found.projector_xy, truth(code.size))


class TestRoundTrip:
    @pytest.mark.parametrize("whole", [False, True], ids=["float", "8 bit"])
    @pytest.mark.parametrize("size", SIZES, ids=str)
    @pytest.mark.parametrize("name", CODES)
    def test_perfect_photographs_give_every_pixel_back(
        self, name: str, size: tuple[int, int], whole: bool
    ) -> None:
        code = make_code(name, size)
        result = decoded(code, photographs(code, whole))
        assert (result.lost, result.notes) == ((), ())
        check_every_pixel(result.map, code)

    @settings(max_examples=25)
    @given(
        name=st.sampled_from(list(CODES)),
        width=st.integers(8, 70),
        height=st.integers(8, 50),
        whole=st.booleans(),
    )
    def test_any_size(self, name: str, width: int, height: int, whole: bool) -> None:
        code = make_code(name, (width, height))
        check_every_pixel(decoded(code, photographs(code, whole)).map, code)

    @pytest.mark.parametrize("size", [(2, 2), (2, 9), (3, 5), (7, 2)], ids=str)
    @pytest.mark.parametrize("name", CODES)
    def test_the_smallest_panels(self, name: str, size: tuple[int, int]) -> None:
        """Stripes need no more than two columns; waves are calibrated on fifty pixels or more."""
        code = make_code(name, size)
        frames = photographs(code, whole=True)
        if code.has_waves:
            with pytest.raises(NotEnoughData, match=r"expected at least 50; is the projector on"):
                decoded(code, frames)
        else:
            check_every_pixel(decoded(code, frames).map, code)

    def test_one_fringe_of_waves_needs_no_number(self) -> None:
        code = wave_code((40, 24), (40.0, 24.0))
        assert Counter(p.kind for p in code.planes) == {"white": 1, "black": 1, "sine": 16}
        found = decoded(code, photographs(code, whole=False)).map
        off = np.mod(found.projector_xy - truth(code.size) + 1, [40.0, 24.0]) - 1
        assert np.nanmax(np.abs(off)) < 0.1 and found.valid.mean() > 0.95


class TestPictures:
    @pytest.mark.parametrize("name", CODES)
    def test_counts(self, name: str) -> None:
        bits = bit_count(SIZE[0]) + bit_count(SIZE[1])
        halves = sum(bit_count(int(np.ceil(n / (64 / 3 / 2)))) for n in SIZE)
        expected = {
            "micro-phase": 18,
            "micro-phase-checked": 2 + 2 * (8 + 2 * 4),
            "phase-heterodyne": 2 + 2 * 12,
            "phase-gray": 2 + 2 * 8 + halves,
        }
        code = make_code(name, SIZE)
        pictures = generate(code)
        assert len(code.planes) == len(pictures) == expected.get(name, 2 + 2 * bits)
        assert {(p.shape, p.dtype.str) for p in pictures} == {((200, 320, 1), "|u1")}
        assert all(p.flags.c_contiguous for p in pictures)

    @pytest.mark.parametrize("name", CODES)
    def test_white_and_black_first_then_columns_then_rows(self, name: str) -> None:
        code = make_code(name, SIZE)
        pictures = generate(code)
        assert [p.kind for p in code.planes[:2]] == ["white", "black"]
        assert (pictures[0] == 255).all() and (pictures[1] == 0).all()
        axes = [p.axis for p in code.planes[2:]]
        assert axes == sorted(axes) and set(axes) == {"x", "y"}

    @pytest.mark.parametrize("name", CODES)
    def test_constant_along_the_other_axis_up_to_one_level(self, name: str) -> None:
        code = make_code(name, SIZE)
        for plane, shown in zip(code.planes, generate(code), strict=True):
            across = 0 if plane.axis == "x" else 1
            spread = int(np.ptp(shown[..., 0].astype(int), axis=across).max())
            assert spread <= (1 if plane.kind == "sine" else 0)

    def test_spread_rounding_averages_away(self) -> None:
        """The mean over neighbouring lines is the exact drive, a hundred times better than rounding."""
        code = make_code("micro-phase", SIZE)
        for plane in code.planes[2:]:
            shown = picture(code, plane)[..., 0].astype(float)
            lines = shown if plane.axis == "x" else shown.T
            drive = 255 * code.axis(plane.axis).line(plane) ** (1 / 2.2)
            inside = drive < 254.5
            assert np.abs(lines.mean(axis=0) - drive)[inside].max() < 0.02
            # of five neighbours already
            assert np.abs(lines[:5].mean(axis=0) - drive)[inside].max() < 0.2

    @pytest.mark.parametrize("gamma", [1.0, 2.2, 2.6])
    def test_sinusoids_are_sinusoids_of_light(self, gamma: float) -> None:
        code = make_code("micro-phase", SIZE)
        for plane, shown in zip(code.planes[2:], generate(code, gamma)[2:], strict=True):
            light = (shown[..., 0] / 255.0) ** gamma
            x = np.arange(light.shape[1 if plane.axis == "x" else 0])
            wave = 0.5 + 0.5 * np.cos(2 * np.pi * x / plane.period - plane.shift)
            expected = wave[None, :] if plane.axis == "x" else wave[:, None]
            assert np.abs(light - expected).max() < gamma / 255

    @pytest.mark.parametrize("name", [*STRIPES, "micro-phase-checked"])
    def test_stripes_are_followed_by_their_inverses(self, name: str) -> None:
        code = make_code(name, SIZE)
        planes = [p for p in code.planes if p.kind == "binary"]
        for plane, inverse in zip(planes[::2], planes[1::2], strict=True):
            assert (plane.inverse, inverse.inverse) == (False, True)
            assert (plane.axis, plane.bit) == (inverse.axis, inverse.bit)
            total = picture(code, plane).astype(int) + picture(code, inverse)
            assert set(np.unique(total)) == {255}

    @pytest.mark.parametrize("name", CODES)
    def test_planes_have_a_name_each(self, name: str) -> None:
        code = make_code(name, SIZE)
        assert len({str(p) for p in code.planes}) == len(code.planes)

    def test_names_of_planes(self) -> None:
        assert [str(p) for p in (Plane("white"), Plane("black"))] == ["white", "black"]
        assert str(Plane("binary", "y", 3, inverse=True)) == "row bit 3 inverse"
        assert (
            str(Plane("sine", "x", period=18.2766, shift=np.pi))
            == "column wave 18.28 px at 180 deg"
        )


class TestMaking:
    def test_an_unknown_name_is_refused_with_all_names(self) -> None:
        with pytest.raises(
            InputError, match=f"code: got 'morse', expected one of {', '.join(CODES)}"
        ):
            make_code("morse", SIZE)

    @pytest.mark.parametrize("size", [(1, 200), (320, 1), (0, 0)])
    @pytest.mark.parametrize("name", CODES)
    def test_a_panel_of_one_line_is_refused(self, name: str, size: tuple[int, int]) -> None:
        with pytest.raises(
            InputError, match=f"size: got {size[0]}x{size[1]}, expected at least 2x2"
        ):
            make_code(name, size)

    def test_the_default_is_one_of_them(self) -> None:
        assert DEFAULT_CODE in CODES and DEFAULT_CODE == "micro-phase"


class TestNumbering:
    """Stripes that number the fringes of waves, or must agree with them."""

    single = AxisCode(
        96, Waves(np.full(4, 16.0), equal_steps(4), 4), np.arange(12), 8.0, inverses=False
    )
    several = AxisCode(96, make_code("micro-phase", SIZE).x.waves, np.arange(8), 12.0)

    def test_fringes_of_one_period_are_numbered_by_half_periods(self) -> None:
        x = np.arange(0, 96, 0.25)
        stripe = np.floor((x + 0.5) / 8)
        found, agree = self.single.numbered(np.mod(x, 16.0), stripe)
        assert agree.all()
        np.testing.assert_allclose(found, x)

    def test_a_stripe_seen_next_door_does_not_matter(self) -> None:
        """At a stripe's edge either side may be seen; the wave decides."""
        for x in (7.3, 7.7, 47.4, 47.6):
            for stripe in (np.floor((x + 0.5) / 8), np.floor((x + 0.5) / 8) + 1):
                if abs((stripe + 0.5) * 8 - 0.5 - x) < 8:
                    found, agree = self.single.numbered(np.array([x % 16.0]), np.array([stripe]))
                    assert (found[0], agree[0]) == (pytest.approx(x), True)

    def test_waves_and_stripes_that_disagree_are_unknown(self) -> None:
        stripe = np.array([0.0, 0.0, 3.0, 3.0, np.nan])
        x = np.array([11.4, 14.0, 35.0, 49.0, 5.0])
        found, agree = self.several.numbered(x, stripe)
        assert agree.tolist() == [True, False, True, False, False]
        np.testing.assert_array_equal(found, np.where(agree, x, np.nan))

    @pytest.mark.parametrize("length", [33, 37, 101, 250])
    def test_columns_of_uneven_stripes_agree(self, length: int) -> None:
        code = make_code("micro-phase-checked", (length, length)).x
        place = {int(word): i for i, word in enumerate(code.codewords)}
        planes = [p for p in code.planes("x") if p.kind == "binary" and not p.inverse]
        word = sum(code.line(p).astype(int) << p.bit for p in planes)
        stripe = np.array([place[int(w)] for w in word], float)
        x = np.arange(length, dtype=float)
        _, agree = code.numbered(x, stripe)
        assert agree.all()
        assert np.abs(x - ((stripe + 0.5) * code.stripe - 0.5)).max() <= code.stripe / 2
