"""What the perceptual methods promise on a screen whose light is one scalar per colour."""

import numpy as np
import pytest

from procam.compensate.perceptual.bounds import hue_limited, limited_places
from procam.compensate.perceptual.guided import Change
from procam.compensate.perceptual.light import FieldTransport, Stage, planes
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.targets import (
    MovieTargets,
    Reached,
    StillTargets,
)
from procam.errors import InputError
from procam.maths.vision.hue import hue_difference
from procam.maths.vision.pu21 import pu21

SIZE = 96
FEEDBACK = 0.33
BLACK = 0.0005
LUMA = np.array([0.2126, 0.7152, 0.0722])


def stage(size: int) -> Stage:
    ones, area = (
        np.ones((3, size, size), np.float32),
        np.full((size, size), 1 / size**2, np.float32),
    )
    operator = np.full((3, 1, 1), FEEDBACK)
    transport = FieldTransport(ones, None, area, np.ones((1, 1, 1)), operator)
    return Stage(np.float32(BLACK) * ones, ones, area, transport, 20.0 * size / SIZE)


def exact(target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Total light (N, N, 3) of (P), and the mean (3, 1) of its direct light."""
    low, high = np.zeros(3), np.ones(3)
    for _ in range(50):
        middle = (low + high) / 2
        mean = np.clip(target - FEEDBACK * middle, BLACK, 1).mean(axis=(0, 1))
        low, high = np.where(mean > middle, middle, low), np.where(mean > middle, high, middle)
    direct = np.clip(target - FEEDBACK * low, BLACK, 1)
    return direct + FEEDBACK * direct.mean(axis=(0, 1)), direct.mean(axis=(0, 1))[:, None]


def error(light: np.ndarray, target: np.ndarray) -> float:
    """Of luminance [PU21 units squared], written anew."""
    return float(((pu21(light @ LUMA * 14) - pu21(target @ LUMA * 14)) ** 2).mean())


def dusk(seed: int = 5, shift: int = 0) -> np.ndarray:
    """A bright sky over dark ground with detail: (N, N, 3)."""
    rng = np.random.default_rng(seed)
    ground = 0.05 * np.exp(0.6 * rng.normal(size=(SIZE, SIZE, 1)))
    light = np.where(np.arange(SIZE)[:, None, None] < SIZE // 2, 0.75, ground)
    return np.roll((light * np.array([1.0, 0.9, 0.8])).astype(np.float32), shift, axis=1)


def reef() -> np.ndarray:
    """Coloured detail under blue water, a picture whose optimum turns hues: (N, N, 3)."""
    rng = np.random.default_rng(12)
    coral = 0.05 * np.exp(0.8 * rng.normal(size=(SIZE, SIZE, 3))) * np.array([1.0, 0.5, 0.5])
    light = np.where(np.arange(SIZE)[:, None, None] < SIZE // 2, [0.25, 0.65, 0.75], coral)
    return light.astype(np.float32)


def still(target: np.ndarray, db: float = 0.0) -> Reached:
    targets = StillTargets(stage(SIZE), stage(SIZE // 4), Perceptual(db))
    return targets.of(target, exact(target)[1])


def contrast(light: np.ndarray) -> float:
    """Deviation of the logarithm of luminance on the ground."""
    return float(np.log(light[SIZE // 2 + 4 :] @ LUMA).std())


class TestStill:
    @pytest.mark.parametrize("db", [0.0, 0.5, 1.0])
    def test_more_contrast_within_the_guard(self, db: float) -> None:
        target = dusk()
        seen, _ = exact(target)
        found = still(target, db)
        light, _ = exact(found.target)
        lost = 10 * np.log10(error(light, target) / error(seen, target))
        assert lost <= db + 1e-3
        assert lost == pytest.approx(found.loss_db, abs=2e-3)
        assert contrast(light) > 1.3 * contrast(seen)
        assert contrast(light) < contrast(target)

    def test_a_picture_within_reach_is_left_alone(self) -> None:
        target = np.full((SIZE, SIZE, 3), 0.5, np.float32)
        found = still(target)
        assert found.share == found.loss_db == 0
        assert found.target is target

    @pytest.mark.parametrize("light", [0.0, 1e-7])
    def test_black_is_left_alone(self, light: float) -> None:
        target = np.full((SIZE, SIZE, 3), light, np.float32)
        assert still(target).share == 0

    def test_one_bright_pixel(self) -> None:
        target = np.zeros((SIZE, SIZE, 3), np.float32)
        target[40, 50] = 1
        found = still(target, 1.0)
        light, _ = exact(found.target)
        assert np.isfinite(found.target).all()
        assert error(light, target) <= 1.26 * error(exact(target)[0], target)
        assert light[40, 50].min() > 0.5


class TestHue:
    @pytest.mark.parametrize("method", ["still", "movie"])
    def test_hues_turn_by_two_at_most(self, method: str) -> None:
        picture = reef()
        seen, mean = exact(picture)
        targets: StillTargets | MovieTargets
        if method == "still":
            targets = StillTargets(stage(SIZE), stage(SIZE // 4), Perceptual(2.0))
        else:
            settings = Perceptual(2.0, video=True)
            targets = MovieTargets(stage(SIZE // 4), stage(SIZE), settings)
        light, _ = exact(targets.of(picture, mean).target)
        limited = (np.abs(seen - picture) > 1e-6).any(axis=-1)
        turned = hue_difference(seen[limited].T, light[limited].T)
        assert 0.3 < float(np.median(turned)) < 2.1
        assert contrast(light) > 1.05 * contrast(seen)

    def test_colours_are_pulled_back_at_the_same_luminance(self) -> None:
        place, target = stage(SIZE), planes(reef())
        problem = place.problem(target, 14.0)
        seen, mean = exact(reef())
        direct = np.clip(planes(seen - FEEDBACK * mean[:, 0]), place.lo, place.hi)
        green = direct.copy()
        green[1, SIZE // 2 :] += np.float32(0.015)
        seen = planes(seen.astype(np.float32))
        places = limited_places(direct, place.lo, place.hi, place.weight)
        found = hue_limited(problem, seen, places, green)
        before, after = (place.transport.total(x) for x in (green, found))
        limited = np.flatnonzero((direct <= place.lo).any(axis=0))
        pick = [light.reshape(3, -1)[:, limited] for light in (seen, before, after)]
        assert np.median(hue_difference(pick[0], pick[1])) > 2
        assert np.median(hue_difference(pick[0], pick[2])) <= 2
        lumas = [np.tensordot(LUMA, light, 1).mean() for light in (before, after)]
        assert lumas[1] == pytest.approx(lumas[0], rel=0.1)


class TestMovie:
    @pytest.mark.parametrize("db", [0.0, 1.0])
    def test_more_contrast_within_the_guard_in_every_frame(self, db: float) -> None:
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(db, video=True))
        for number in range(6):
            target = dusk(shift=2 * number)
            seen, mean = exact(target)
            found = targets.of(target, mean)
            light, _ = exact(found.target)
            lost = 10 * np.log10(error(light, target) / error(seen, target))
            assert lost <= db + 2e-3
            assert found.loss_db == pytest.approx(lost, abs=0.02)
            assert contrast(light) > 1.1 * contrast(seen)

    def test_frames_follow_each_other_smoothly(self) -> None:
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(1.0, video=True))
        lights = []
        for number in range(8):
            target = dusk(shift=number)
            found = targets.of(target, exact(target)[1])
            lights.append(np.roll(np.log(exact(found.target)[0]), -number, axis=1))
        alone = []
        for number in (6, 7):
            target = dusk(shift=number)
            one = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(1.0, video=True))
            found = one.of(target, exact(target)[1])
            alone.append(np.roll(np.log(exact(found.target)[0]), -number, axis=1))
        flicker, each = (np.std(b - a) for a, b in (lights[6:], alone))
        assert flicker < 0.75 * each

    def test_a_cut_starts_anew(self) -> None:
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(1.0, video=True))
        first, second = dusk(), np.ascontiguousarray(dusk(9)[::-1])
        for target in (first, first):
            targets.of(target, exact(target)[1])
        after = targets.of(second, exact(second)[1])
        fresh = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(1.0, video=True))
        expected = fresh.of(second, exact(second)[1])
        np.testing.assert_array_equal(after.target, expected.target)

    def test_a_sample_keeps_the_guard_with_a_margin(self) -> None:
        target = dusk()
        seen, mean = exact(target)
        sampled = MovieTargets(stage(SIZE // 4), stage(SIZE // 3), Perceptual(0.0, video=True))
        found = sampled.of(target, mean)
        light, _ = exact(found.target)
        assert error(light, target) <= 1.001 * error(seen, target)

    def test_a_frame_that_stands_still_is_shown_the_same(self) -> None:
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(1.0, video=True))
        frame = dusk()
        mean = exact(frame)[1]
        first = targets.of(frame, mean)
        for _ in range(3):
            np.testing.assert_array_equal(targets.of(frame, mean).target, first.target)

    @pytest.mark.parametrize("dark", [0.0, 0.001])
    def test_a_dim_thing_that_moves_over_black(self, dark: float) -> None:
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(1.0, video=True))
        for number in range(10):
            frame = np.full((SIZE, SIZE, 3), dark, np.float32)
            frame[70:80, 20:60] = 0.6
            at = slice(10 + 4 * number, 22 + 4 * number)
            frame[40:52, at] = 0.15
            light, _ = exact(targets.of(frame, exact(frame)[1]).target)
            assert light[42:50, at].max() < 0.4

    @pytest.mark.parametrize("db", [0.0, 1.0])
    def test_a_long_still_in_a_movie(self, db: float) -> None:
        """Stars: hardly anything is limited, so that errors to work with are nearly 0."""
        rng = np.random.default_rng(6)
        stars = np.full((SIZE, SIZE, 3), 0.004, np.float32)
        stars[rng.integers(0, SIZE, 60), rng.integers(0, SIZE, 60)] = 0.8
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(db, video=True))
        seen, mean = exact(stars)
        for _ in range(60):
            found = targets.of(stars, mean)
            assert np.isfinite(found.target).all()
        light, _ = exact(found.target)
        assert error(light, stars) <= 10 ** (db / 10) * error(seen, stars) * 1.001

    def test_black_between_frames(self) -> None:
        targets = MovieTargets(stage(SIZE // 4), stage(SIZE), Perceptual(video=True))
        black = np.zeros((SIZE, SIZE, 3), np.float32)
        for target in (dusk(), black, black, dusk()):
            found = targets.of(target, exact(target)[1])
            seen, light = exact(target)[0], exact(found.target)[0]
            assert (contrast(light) > 1.1 * contrast(seen)) == (target is not black)
            if target is black:
                np.testing.assert_allclose(light, seen, rtol=1e-5)


class TestChange:
    def test_a_line_is_found(self, rng: np.random.Generator) -> None:
        target = rng.uniform(0.3, 0.6, (3, 40, 40)).astype(np.float32)
        total = np.float32(1.2) * target + np.float32(0.05)
        change = Change.fitted(target, total)
        np.testing.assert_allclose(change.gain[:, 5:-5, 5:-5], 1.2, atol=0.08)
        np.testing.assert_allclose(change.gain * target + change.offset, total, atol=0.02)

    def test_without_contrast_it_is_the_ratio(self) -> None:
        grey = np.full((3, 12, 12), 0.2, np.float32)
        change = Change.fitted(grey, 2 * grey)
        np.testing.assert_allclose(change.gain, 2, rtol=1e-4)
        np.testing.assert_allclose(change.offset, 0, atol=1e-6)

    def test_in_black_there_is_no_ratio(self) -> None:
        black = np.zeros((3, 12, 12), np.float32)
        change = Change.fitted(black, black + np.float32(0.08))
        assert change.gain.max() <= 4
        np.testing.assert_allclose(change.gain * black + change.offset, 0.08, rtol=1e-5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"db": -0.1}, "db: -0.1 is below 0 or no number"),
        ({"db": float("nan")}, "db: nan is below 0 or no number"),
        ({"white_nits": 0.0}, "white_nits: 0 is not above 0"),
        ({"white_nits": float("inf")}, "white_nits: inf is not above 0"),
    ],
)
def test_settings(settings: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Perceptual(**settings)  # type: ignore[arg-type]
