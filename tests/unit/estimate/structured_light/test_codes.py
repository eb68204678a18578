"""The structured-light codes: their patterns, and perfect photographs of them decoded again."""

from collections import Counter

import numpy as np
import pytest

from procam.errors import InputError, NotEnoughData
from procam.estimate.structured_light.codes import (
    CODES,
    Code,
    generate,
    make_code,
    picture,
)
from procam.estimate.structured_light.decode import Decoded, Decoder
from procam.model.correspondence import CorrespondenceMap
from studies.one_fringe import wave_code

SIZE = (320, 200)


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
    @pytest.mark.parametrize("size", [(16, 9), (37, 101)], ids=str)
    @pytest.mark.parametrize("name", CODES)
    def test_perfect_photographs_give_every_pixel_back(
        self, name: str, size: tuple[int, int], whole: bool
    ) -> None:
        code = make_code(name, size)
        result = decoded(code, photographs(code, whole))
        assert result.notes == ()
        check_every_pixel(result.map, code)

    @pytest.mark.parametrize("name", CODES)
    def test_the_smallest_panel(self, name: str) -> None:
        """Stripes need no more than two columns; sinusoids are calibrated on fifty pixels or more."""
        code = make_code(name, (2, 2))
        frames = photographs(code, whole=True)
        if code.has_waves:
            with pytest.raises(NotEnoughData, match=r"50"):
                decoded(code, frames)
        else:
            check_every_pixel(decoded(code, frames).map, code)

    def test_a_single_period_gives_the_position_within_it(self) -> None:
        code = wave_code((40, 24), (40.0, 24.0))
        assert Counter(p.kind for p in code.planes) == {"white": 1, "black": 1, "sine": 16}
        found = decoded(code, photographs(code, whole=False)).map
        off = np.mod(found.projector_xy - truth(code.size) + 1, [40.0, 24.0]) - 1
        assert np.nanmax(np.abs(off)) < 0.1 and found.valid.mean() > 0.95


class TestPatterns:
    @pytest.mark.parametrize("name", CODES)
    def test_order_count_and_type(self, name: str) -> None:
        expected = {
            "micro-phase": 18,
            "gray": 2 + 2 * sum((n - 1).bit_length() for n in SIZE),
            "phase-heterodyne": 2 + 2 * 12,
        }
        code = make_code(name, SIZE)
        patterns = generate(code)
        assert len(code.planes) == len(patterns) == expected[name]
        assert len({str(p) for p in code.planes}) == len(code.planes)
        assert {(p.shape, p.dtype.str) for p in patterns} == {((200, 320, 1), "|u1")}
        assert all(p.flags.c_contiguous for p in patterns)
        assert [p.kind for p in code.planes[:2]] == ["white", "black"]
        assert (patterns[0] == 255).all() and (patterns[1] == 0).all()
        axes = [p.axis for p in code.planes[2:]]
        assert axes == sorted(axes) and set(axes) == {"x", "y"}

    def test_dithered_rounding_averages_away(self) -> None:
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

    @pytest.mark.parametrize("gamma", [1.0, 2.2])
    def test_sinusoids_are_sinusoids_of_light(self, gamma: float) -> None:
        code = make_code("micro-phase", SIZE)
        for plane, shown in zip(code.planes[2:], generate(code, gamma)[2:], strict=True):
            light = (shown[..., 0] / 255.0) ** gamma
            x = np.arange(light.shape[1 if plane.axis == "x" else 0])
            wave = 0.5 + 0.5 * np.cos(2 * np.pi * x / plane.period - plane.shift)
            expected = wave[None, :] if plane.axis == "x" else wave[:, None]
            assert np.abs(light - expected).max() < gamma / 255


class TestMaking:
    @pytest.mark.parametrize("name", ["morse", "xor-02"])
    def test_an_unknown_or_deleted_code_is_refused_with_all_names(self, name: str) -> None:
        expected = f"code: '{name}' is not .*; choose {', '.join(CODES)}. A session .* again"
        with pytest.raises(InputError, match=expected):
            make_code(name, SIZE)

    @pytest.mark.parametrize("size", [(1, 200), (320, 1), (320, 16385)])
    def test_a_panel_of_one_line_or_too_many_is_refused(self, size: tuple[int, int]) -> None:
        with pytest.raises(InputError, match=f"size: {size[0]}x{size[1]} px is not a panel"):
            make_code("gray", size)
