"""Shot marks: read through blur, noise, rotation, bending, gamma and low contrast; never wrong."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from procam.errors import InputError
from procam.maths.codes.shot_id import (
    SHOT_ID_COUNT,
    draw_shot_id,
    read_shot_id,
    shot_id_blocks,
    shot_id_pixels,
)

SIZE = (160, 100)
PHOTO = (290, 330)
GAMMA = 2.2
TRIED = 300
WRONG = 1e-3  # share of photographs that may give a wrong number


def backgrounds() -> list[np.ndarray]:
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    levels = np.random.default_rng(0).choice([0, 64, 128, 255], (7, 10))
    tiles = np.kron(levels, np.ones((16, 16)))[: SIZE[1], : SIZE[0]]
    waves = 127.5 + 127.5 * np.sin(2 * np.pi * x / 16)
    planes = [0 * x + 255, 255 * (x // 8 % 2), 255 * (y // 4 % 2), waves, tiles]
    return [np.repeat(plane[..., None], 3, axis=2).astype(np.uint8) for plane in planes]


BACKGROUNDS = backgrounds()


def photograph(
    picture: np.ndarray,
    rng: np.random.Generator,
    *,
    blur_px: float = 1.0,
    noise: float = 0.01,
    contrast: float = 1.0,
    turn_deg: float = 0.0,
    bend: float = 0.0,
    gamma: float = GAMMA,
) -> np.ndarray:
    """Linear light of a picture twice its size on a bent screen, turned, blurred and noisy."""
    v, u = np.mgrid[: PHOTO[0], : PHOTO[1]].astype(np.float32)
    x, y = u - PHOTO[1] / 2, v - PHOTO[0] / 2
    angle = np.radians(turn_deg)
    x, y = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
    radius2 = (x**2 + y**2) / 150**2
    scale = (1 + bend * radius2) * (1 + 0.15 * bend * x / 150) / 2.0
    x, y = x * scale + SIZE[0] / 2, y * scale + SIZE[1] / 2
    light = ((picture / 255.0) ** gamma).mean(axis=2).astype(np.float32)
    seen = cv2.remap(light, np.float32(x), np.float32(y), cv2.INTER_LINEAR)
    seen = cv2.GaussianBlur(seen, (0, 0), blur_px)
    veiled = (1 - contrast) * 0.3 + contrast * seen
    return veiled + rng.normal(0, noise, veiled.shape)


class TestReading:
    @given(
        number=st.integers(0, SHOT_ID_COUNT - 1),
        background=st.integers(0, len(BACKGROUNDS) - 1),
        blur_px=st.floats(0.3, 2.0),
        noise=st.floats(0, 0.02),
        turn_deg=st.floats(0, 360),
        bend=st.floats(-0.2, 0.3),
        gamma=st.floats(1.6, 2.6),
        seed=st.integers(0, 2**31),
    )
    def test_is_read_on_a_curved_screen_out_of_focus(
        self, number: int, background: int, seed: int, **conditions: float
    ) -> None:
        drawn = draw_shot_id(BACKGROUNDS[background], number)
        seen = photograph(drawn, np.random.default_rng(seed), **conditions)
        assert read_shot_id(seen) == number

    @given(contrast=st.floats(0.05, 1), exponent=st.floats(0.4, 1.0), seed=st.integers(0, 2**31))
    def test_low_contrast_and_a_response(self, contrast: float, exponent: float, seed: int) -> None:
        number = seed % SHOT_ID_COUNT
        drawn = draw_shot_id(BACKGROUNDS[seed % len(BACKGROUNDS)], number)
        seen = photograph(drawn, np.random.default_rng(seed), contrast=contrast, noise=0.002)
        assert read_shot_id(np.clip(seen, 0, None) ** exponent) == number

    def test_a_corner_of_the_picture_is_enough(self, rng: np.random.Generator) -> None:
        seen = photograph(draw_shot_id(BACKGROUNDS[3], 123), rng)
        height, width = seen.shape
        for rows in (slice(0, height // 2), slice(height // 2, None)):
            for columns in (slice(0, width // 2), slice(width // 2, None)):
                assert read_shot_id(seen[rows, columns]) == 123

    def test_bad_photographs_are_unreadable_but_not_wrong(self, rng: np.random.Generator) -> None:
        wrong = read = 0
        for i in range(TRIED):
            number = int(rng.integers(SHOT_ID_COUNT))
            drawn = draw_shot_id(BACKGROUNDS[i % len(BACKGROUNDS)], number)
            blur_px, noise = rng.uniform(1.5, 6.0), rng.uniform(0, 0.1)
            seen = photograph(drawn, rng, blur_px=blur_px, noise=noise)
            found = read_shot_id(seen[:150, :170])
            read += found == number
            wrong += found not in (None, number)
        assert wrong <= TRIED * WRONG
        assert 0.1 * TRIED < read < 0.9 * TRIED  # the conditions reach from easy to hopeless

    def test_pictures_without_a_number(self, rng: np.random.Generator) -> None:
        for background in BACKGROUNDS:
            assert read_shot_id(photograph(background, rng)) is None
        assert read_shot_id(np.zeros((50, 80), np.uint16)) is None
        assert read_shot_id(rng.normal(0, 1, (300, 400))) is None

    def test_two_pictures_in_one_exposure_contradict_each_other(
        self, rng: np.random.Generator
    ) -> None:
        first, second = (photograph(draw_shot_id(BACKGROUNDS[0], n), rng) for n in (5, 300))
        assert read_shot_id(first + second) is None
        halves = np.concatenate([first[:145], second[145:]])
        assert read_shot_id(halves) is None

    def test_raw_counts_in_colour(self, rng: np.random.Generator) -> None:
        red = BACKGROUNDS[0] * np.array([1, 0, 0], np.uint8)
        drawn = draw_shot_id(red, 77)
        assert drawn[..., 1:].max() == 0
        seen = photograph(drawn, rng, noise=0.003)
        counts = np.stack([3000 * seen + 64, 200 * seen + 64, 0 * seen + 64], axis=-1)
        assert read_shot_id(np.clip(counts, 0, 4095).astype(np.uint16)) == 77

    def test_a_dim_mark_in_black(self, rng: np.random.Generator) -> None:
        black = np.zeros((SIZE[1], SIZE[0], 1), np.uint8)
        drawn = draw_shot_id(black, 9, drive=23)
        assert drawn.max() == 23
        assert read_shot_id(photograph(drawn, rng, noise=2e-4)) == 9

    def test_a_photograph_of_many_pixels(self, rng: np.random.Generator) -> None:
        seen = photograph(draw_shot_id(BACKGROUNDS[4], 321), rng)
        large = cv2.resize(seen, None, fx=6, fy=6)
        assert read_shot_id(large) == 321


class TestDrawing:
    @given(st.integers(120, 4096), st.integers(80, 2400))
    def test_blocks_lie_on_the_panel_and_apart(self, width: int, height: int) -> None:
        taken = np.zeros((height, width), np.uint8)
        for x, y, across, down in shot_id_blocks((width, height)):
            assert 0 <= x <= width - across
            assert 0 <= y <= height - down
            taken[y : y + down, x : x + across] += 1
        assert taken.max() == 1
        np.testing.assert_array_equal(shot_id_pixels((width, height)), taken == 1)

    @pytest.mark.parametrize(("size", "share"), [((1920, 1200), 0.024)])
    def test_little_of_the_panel_is_taken(self, size: tuple[int, int], share: float) -> None:
        assert shot_id_pixels(size).mean() < share

    def test_nothing_else_of_the_picture_changes(self) -> None:
        for picture in BACKGROUNDS:
            drawn = draw_shot_id(picture, 42)
            same = (drawn == picture).all(axis=2)
            assert same[~shot_id_pixels(SIZE)].all()
            assert drawn.shape == picture.shape

    def test_refusals(self) -> None:
        with pytest.raises(InputError, match=r"shot id: 587 is not in 0\.\.586"):
            draw_shot_id(BACKGROUNDS[0], SHOT_ID_COUNT)
        with pytest.raises(InputError, match="panel: 64x40 px is too small"):
            shot_id_blocks((64, 40))
