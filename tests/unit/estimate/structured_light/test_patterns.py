"""The plan of a capture session and its patterns."""

import numpy as np
import pytest

from procam.estimate.structured_light.codes import generate, make_code
from procam.estimate.structured_light.patterns import (
    LEVEL_PICTURES,
    LEVELS,
    level_pictures,
    level_tile,
    plan_session,
    stripe_picture,
    zone_count,
    zone_picture,
)
from procam.maths.codes.gray import encode_gray
from procam.model.plan import Plan

SIZES = {"south": (320, 200), "north": (100, 75)}
Pictures = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def session() -> tuple[Plan, Pictures]:
    return plan_session(SIZES, 0.13, 6.5)


class TestPlan:
    def test_dark_first_then_projector_by_projector_white_and_black_first(
        self, session: tuple[Plan, Pictures]
    ) -> None:
        shots = session[0].shots
        assert (shots[0].purpose, shots[0].projector, shots[0].pattern) == ("dark", "", "")
        assert shots[0].exposures_s == (0.13, 6.5)
        order = [s.projector for s in shots[1:-1]]
        assert order == sorted(order, reverse=True)  # south before north
        for name in SIZES:
            mine = [s.purpose for s in shots if s.projector == name]
            assert mine[:2] == ["white", "black"]

    def test_ids_are_unique_and_every_pattern_is_there(
        self, session: tuple[Plan, Pictures]
    ) -> None:
        plan, pictures = session
        assert len({s.id for s in plan.shots}) == len(plan.shots)
        assert {s.pattern for s in plan.shots if s.pattern} == set(pictures)
        for shot in plan.shots[1:]:
            width, height = SIZES[shot.projector]
            picture = pictures[shot.pattern]
            assert picture.shape[:2] == (height, width) and picture.shape[2] in (1, 3)
            assert picture.dtype == np.uint8

    def test_only_black_has_the_long_exposure(self, session: tuple[Plan, Pictures]) -> None:
        for shot in session[0].shots[1:-1]:
            assert shot.exposures_s == ((6.5, 0.13) if shot.purpose == "black" else (0.13,))

    def test_the_first_projector_ends_with_a_dim_white_for_both_exposures(
        self, session: tuple[Plan, Pictures]
    ) -> None:
        last = session[0].shots[-1]
        assert (last.projector, last.purpose, last.exposures_s) == ("south", "dim", (0.13, 6.5))
        (level,) = np.unique(session[1][last.pattern])
        assert (level / 255) ** 2.2 == pytest.approx(0.5 * 0.13 / 6.5, rel=0.05)
        alike = plan_session(SIZES, 0.13, 0.13)[0].shots[-1]
        assert alike.exposures_s == (0.13,)

    def test_all_but_the_code_is_captured_in_colour(self, session: tuple[Plan, Pictures]) -> None:
        for shot in session[0].shots:
            assert shot.pixel_format == ("mono" if shot.purpose == "code" else "rgb")


class TestCode:
    @pytest.mark.parametrize("name", SIZES)
    def test_its_planes_are_those_of_micro_phase_shifting_in_order(
        self, session: tuple[Plan, Pictures], name: str
    ) -> None:
        plan, pictures = session
        code = make_code("micro-phase", SIZES[name])
        shots = plan.of(name, "code")
        assert [dict(s.detail) for s in shots] == [
            {"code": "micro-phase", "plane": number} for number in range(2, len(code.planes))
        ]
        for shot, expected in zip(shots, generate(code)[2:], strict=True):
            np.testing.assert_array_equal(pictures[shot.pattern], expected)


class TestStripes:
    @pytest.mark.parametrize("name", SIZES)
    def test_middle_bits_of_both_axes(self, session: tuple[Plan, Pictures], name: str) -> None:
        plan, pictures = session
        shots = plan.of(name, "stripes")
        assert [(s.detail["axis"], s.detail["bit"], s.detail["inverse"]) for s in shots] == [
            (axis, bit, inverse) for axis in "xy" for bit in (6, 5) for inverse in (0, 1)
        ]
        for shot in shots:
            expected = stripe_picture(
                SIZES[name], str(shot.detail["axis"]), int(shot.detail["bit"]), False
            )
            flip = 255 * int(shot.detail["inverse"])
            np.testing.assert_array_equal(pictures[shot.pattern] ^ flip, expected)

    def test_they_show_the_gray_code_of_columns_and_rows(self) -> None:
        width, height = 97, 61
        for axis, length in (("x", width), ("y", height)):
            words = encode_gray(np.arange(length))
            words = words[None, :] if axis == "x" else words[:, None]
            for bit in range(6):
                shown = stripe_picture((width, height), axis, bit, False)[..., 0]
                expected = np.broadcast_to(255 * (words >> bit & 1), (height, width))
                np.testing.assert_array_equal(shown, expected)


class TestOthers:
    def test_white_black_and_primaries(self, session: tuple[Plan, Pictures]) -> None:
        plan, pictures = session
        assert (pictures[plan.of("south", "white")[0].pattern] == 255).all()
        assert (pictures[plan.of("south", "black")[0].pattern] == 0).all()
        for channel, shot in enumerate(plan.of("south", "primary")):
            assert shot.detail["channel"] == channel
            expected = np.zeros(3)
            expected[channel] = 255
            assert (pictures[shot.pattern] == expected).all()

    def test_levels_hold_every_drive_equally_often(self) -> None:
        size = (1280, 17 * 32)
        assert level_tile(size) == 32
        pictures = level_pictures(size)
        assert len(pictures) == LEVEL_PICTURES
        for picture in pictures:
            drive, count = np.unique(picture, return_counts=True)
            assert tuple(drive) == LEVELS
            assert set(count) == {40 * 32 * 32}


@pytest.mark.parametrize("projectors", [1, 2, 3, 6])
def test_zones_divide_the_panel(projectors: int) -> None:
    count = zone_count(projectors)
    zones = [zone_picture((321, 201), zone, count) for zone in range(count)]
    np.testing.assert_array_equal(np.sum(zones, axis=0), 255)
    lit = [int((zone > 0).sum()) for zone in zones]
    assert max(lit) < 1.03 * min(lit)
    assert projectors * count >= 12 or projectors == 1
    assert 2 + 8 + count + 3 + LEVEL_PICTURES <= 24  # photographs of a projector's light
