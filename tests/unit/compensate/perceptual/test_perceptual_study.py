"""The study in small: its pictures, its other methods, and the bounds by its judge's own formulas."""

import hashlib
from importlib.resources import files

import cv2
import numpy as np
import pytest

from procam.compensate.perceptual.settings import Perceptual
from procam.maths.vision.pu21 import pu21
from studies import picture_judge, picture_set
from studies.perceptual import direct_mean, gain, hue_shift
from studies.perceptual_baselines import BLACK, METHODS, FlatScreen
from studies.picture_set import DRAWN, HELD_OUT, STORED, TRAINING, picture

SIZE = 96
FEEDBACK = 0.33


def small(name: str) -> np.ndarray:
    return cv2.resize(picture(name), (SIZE, SIZE), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def screen() -> FlatScreen:
    return FlatScreen(SIZE, FEEDBACK)


def direct_of(light: np.ndarray) -> np.ndarray:
    return light - FEEDBACK * direct_mean(light, FEEDBACK)


class TestPictures:
    def test_the_split(self) -> None:
        assert not set(TRAINING) & set(HELD_OUT)
        assert {*TRAINING, *HELD_OUT} == {*DRAWN, *STORED}
        assert len(HELD_OUT) >= 12

    @pytest.mark.parametrize("name", [*TRAINING, *HELD_OUT])
    def test_each(self, name: str) -> None:
        light = picture(name)
        assert light.shape == (256, 256, 3)
        assert light.dtype == np.float32
        assert 0 <= light.min() < light.max() <= 1
        np.testing.assert_array_equal(light, picture(name))

    def test_enough_of_them_are_limited(self) -> None:
        wide, shares = FlatScreen(256, FEEDBACK), []
        for name in HELD_OUT:
            target = picture(name)
            shares.append(float((wide.exact(target) > target + 1e-6).any(axis=-1).mean()))
        assert sum(share > 0.2 for share in shares) >= 4

    def test_stored_ones_are_those_of_the_study(self, monkeypatch: pytest.MonkeyPatch) -> None:
        folder = files("calib_data").joinpath("pictures")
        for name, known in STORED.items():
            data = folder.joinpath(f"{name}.png").read_bytes()
            assert hashlib.sha256(data).hexdigest() == known
        monkeypatch.setattr(picture_set, "STORED", {"coffee": "0" * 64})
        with pytest.raises(ValueError, match=r"coffee\.png has changed; restore it"):
            picture("coffee")


def test_the_judge_has_the_same_units() -> None:
    nits = np.geomspace(1e-4, 2e4, 500)
    np.testing.assert_allclose(picture_judge.pu21(nits), pu21(nits), atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_light_that_is_shown_is_within_the_limits(screen: FlatScreen, method: str) -> None:
    light = METHODS[method](screen, small("hopper"))
    direct = direct_of(light.astype(float))
    assert direct.min() > BLACK - 1e-6
    assert direct.max() < 1 + 1e-6


def test_least_squares_are_least(screen: FlatScreen) -> None:
    target = small("hopper")
    errors = {
        name: float(np.square(METHODS[name](screen, target) - target).sum())
        for name in ("none", "(P)", "(W)", "tone curve", "perceptual, 0 dB")
    }
    assert min(errors, key=errors.__getitem__) == "(W)"


@pytest.mark.parametrize("name", ["hopper", "sunset", "reef"])
@pytest.mark.parametrize("db", [0.0, 1.0])
def test_bounds_by_the_judge(screen: FlatScreen, name: str, db: float) -> None:
    target = small(name)
    exact = screen.exact(target)
    light = screen.still(target, Perceptual(db, picture_judge.WHITE))
    wanted, *seen = (
        picture_judge.pu21(each @ picture_judge.LUMA * picture_judge.WHITE)
        for each in (target, exact, light)
    )
    before, after = (float(np.square(units - wanted).mean()) for units in seen)
    assert 10 * np.log10(after / before) <= db + 1e-3
    limited = (exact > target + 1e-6).any(axis=-1)
    assert hue_shift(exact, light, limited) <= 2.02


def test_gains_are_those_over_the_exact_method() -> None:
    rows = [
        {"feedback": 0.33, "picture": p, "method": m, "jod": jod}
        for p, m, jod in (("a", "(P)", 8.0), ("a", "x", 8.5), ("b", "(P)", 9.0), ("b", "x", 8.9))
    ]
    found = gain([*rows, {**rows[1], "feedback": 0.5, "jod": 1.0}], 0.33, "x")
    assert found == {"a": 0.5, "b": pytest.approx(-0.1)}
