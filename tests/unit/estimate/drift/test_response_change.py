"""Changes of known responses."""

import numpy as np
import pytest

from procam.estimate.drift.response_change import (
    DRIVES,
    LevelLight,
    compare_levels,
    raised_drive,
    tile_index,
)
from procam.estimate.structured_light.patterns import LEVELS, level_pictures
from procam.model.photometry import Photometry, ResponseCurve
from procam.model.transport import Measured


def light(
    rng: np.random.Generator,
    exponent: float = 2.2,
    raised: float = 0.0,
    span: float = 1.0,
    scattered: float = 0.2,
    ends: tuple[float, float] = (0.0, 1.0),
) -> LevelLight:
    """Light of the levels over white: direct, and scattered light of the picture's mean."""
    drive = np.clip((DRIVES - ends[0]) / (ends[1] - ends[0]), 0, 1)
    own = (raised + (1 - raised) * drive) ** exponent - raised**exponent
    own = span * own / (1 - raised**exponent)
    share = (1 - scattered) * own + scattered * own.mean()
    mean = share[:, None] + rng.normal(0, 3e-4, (len(DRIVES), 3))
    return LevelLight(mean, np.full_like(mean, 3e-4))


@pytest.mark.parametrize("factor", [0.85, 1.0, 1.12])
def test_the_exponent_whatever_scatters(factor: float, rng: np.random.Generator) -> None:
    found = compare_levels(light(rng), light(rng, 2.2 * factor, scattered=0.3), 0.0)
    assert found is not None
    assert found.exponent == pytest.approx(factor, abs=max(4 * found.exponent_sigma, 0.004))


def test_a_doubtful_change_is_none(rng: np.random.Generator) -> None:
    before, other = light(rng), light(rng, ends=(0.05, 1.0))
    found = compare_levels(before, other, 0.0)
    assert found is not None and max(found.clipping.excess, found.rest.excess) > 1
    unsure = compare_levels(before, other.doubtful(0.03), 0.0)
    assert unsure is not None and max(unsure.clipping.excess, unsure.rest.excess) < 1


def test_levels_that_fall_are_no_response(rng: np.random.Generator) -> None:
    falling = light(rng)
    falling = LevelLight(-falling.mean, falling.sigma)
    assert compare_levels(falling, falling, 0.0) is None


def test_a_raised_black_is_no_exponent(rng: np.random.Generator) -> None:
    found = compare_levels(light(rng), light(rng, raised=0.06), 0.06)
    assert found is not None
    assert found.exponent == pytest.approx(1.0, abs=0.02)
    blamed = compare_levels(light(rng), light(rng, raised=0.06), 0.0)
    assert blamed is not None and abs(blamed.exponent - 1) > 0.05


def test_the_span_of_an_iris(rng: np.random.Generator) -> None:
    found = compare_levels(light(rng), light(rng, span=0.7), 0.0)
    assert found is not None
    assert np.allclose(found.span, 0.7, atol=0.01)
    assert found.exponent == pytest.approx(1.0, abs=0.005)


def test_more_scattered_light_is_taken_out_of_the_span(rng: np.random.Generator) -> None:
    # scattered light per direct light 1.5 times what it was: the share of direct light falls
    before, more = 0.2, 0.3 / 1.1
    found = compare_levels(light(rng, scattered=before), light(rng, scattered=more), 0.0)
    assert found is not None
    assert found.span.mean() == pytest.approx((1 - more) / (1 - before), abs=0.005)
    ratio = np.full(3, more / (1 - more) * (1 - before) / before)
    assert np.allclose(
        found.without_scatter(before, Measured(ratio, np.zeros(3))).span, 1.0, atol=0.006
    )


def test_a_dead_channel_has_no_response(rng: np.random.Generator) -> None:
    now = light(rng)
    now.mean[:, 1] = 0.0
    found = compare_levels(light(rng), now, 0.0)
    assert found is not None
    assert np.isnan(found.span[1]) and found.exponent == pytest.approx(1.0, abs=0.005)
    now.mean[:] = np.nan
    assert compare_levels(light(rng), now, 0.0) is None


@pytest.mark.parametrize("ends", [(16 / 255, 235 / 255), (0.0, 240 / 255), (16 / 255, 1.0)])
def test_the_ends_of_a_signal_range(ends: tuple[float, float], rng: np.random.Generator) -> None:
    found = compare_levels(light(rng), light(rng, ends=ends), 0.0)
    assert found is not None
    assert np.allclose(found.ends, ends, atol=0.006)
    assert found.exponent == 1.0 and found.rest.excess < 1
    drive = np.linspace(0, 1, 1001)
    true = np.clip((drive - ends[0]) / (ends[1] - ends[0]), 0, 1) ** 2.2 - drive**2.2
    effect = true[np.abs(true).argmax()]
    assert found.clipping.size == pytest.approx(effect, abs=0.01) and found.clipping.excess > 1


def test_ends_and_exponent_together(rng: np.random.Generator) -> None:
    now = light(rng, 2.2 * 1.2, ends=(16 / 255, 235 / 255))
    found = compare_levels(light(rng), now, 0.0)
    assert found is not None
    assert np.allclose(found.ends, (16 / 255, 235 / 255), atol=0.01)
    assert found.exponent == pytest.approx(1.2, abs=0.03)


def test_nothing_is_no_other_range(rng: np.random.Generator) -> None:
    for _ in range(20):
        found = compare_levels(light(rng), light(rng), 0.0)
        assert found is not None
        assert np.array_equal(found.ends, (0, 1)) and found.clipping.excess == 0
        assert found.rest.excess < 0.2


def test_the_exponent_of_one_channel(rng: np.random.Generator) -> None:
    now = light(rng)
    now.mean[:, 2] = light(rng, 2.2 * 1.1).mean[:, 2]
    found = compare_levels(light(rng), now, 0.0)
    assert found is not None
    assert found.each == pytest.approx([1, 1, 1.1], abs=0.005)


def test_what_nothing_explains(rng: np.random.Generator) -> None:
    now = light(rng)
    now.mean[8, 1] += 0.05
    rest = compare_levels(light(rng), now, 0.0).rest  # type: ignore[union-attr]
    assert (rest.channel, rest.drive) == (1, DRIVES[8]) and rest.excess > 1
    assert rest.size == pytest.approx(0.06, abs=0.01)  # over the direct light of white


def test_levels_that_are_seen_in_both_suffice(rng: np.random.Generator) -> None:
    """Of a session whose tiles had three levels, or of a panel that is seen in part."""
    before, now = light(rng), light(rng, 2.2 * 1.1)
    few = np.full(len(DRIVES), np.nan)
    few[[0, 8, 16]] = 0
    before.mean[:] += few[:, None]
    found = compare_levels(before, now, 0.0)
    assert found is not None
    assert found.exponent == pytest.approx(1.1, abs=max(4 * found.exponent_sigma, 0.005))
    before.mean[8] = np.nan
    assert compare_levels(before, now, 0.0) is None


def test_the_drive_of_a_black() -> None:
    levels = np.linspace(0, 1, 257)
    curve = ResponseCurve(levels, np.stack([levels**2.2] * 3, 1), np.zeros((257, 3)))
    photometry = Photometry(curve, np.eye(3), np.ones((2, 2, 3), np.float32))
    assert raised_drive(photometry, 0.05**2.2) == pytest.approx(0.05, abs=1e-3)
    assert raised_drive(photometry, -1e-3) == 0.0


def test_levels_of_tiles(rng: np.random.Generator) -> None:
    picture = level_pictures((320, 200))[0] / 255
    pixel = np.stack(np.meshgrid(np.arange(320), np.arange(200)), -1).astype(float)
    index = tile_index(picture, pixel)
    inside = index >= 0
    assert 0.05 < inside.mean() < 0.5
    assert np.array_equal(np.array(LEVELS)[index[inside]], np.rint(255 * picture[inside][:, 0]))
    white = np.full((200, 320, 3), 2.0)
    scattered = 1 + 0.2 * pixel[..., :1] / 320  # differs within a level
    tiles = white * picture * scattered
    noisy = tiles + rng.normal(0, 1e-3, white.shape)
    before, now = LevelLight.pair((tiles, white), (0.97 * noisy, white), index)
    assert np.allclose(before.mean, 1.1 * DRIVES[:, None], rtol=0.1, atol=1e-3)
    assert np.allclose(now.mean, 0.97 * before.mean, atol=1e-3)
    assert np.all(now.sigma < 1e-3)
    few, _ = LevelLight.pair((tiles, white), (tiles, white), np.where(index == 3, -1, index))
    assert np.isnan(few.mean[3]).all() and np.isfinite(few.mean[4]).all()


def test_tiles_that_are_darker_than_black_are_no_change(rng: np.random.Generator) -> None:
    """The black tile gets more scattered light than its neighbour, as on a small panel."""
    before = light(rng)
    before.mean[0] += 0.02
    found = compare_levels(before, before, 0.0)
    assert found is not None
    assert abs(found.rest.size) < 1e-9
