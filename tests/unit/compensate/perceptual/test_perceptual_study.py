"""The study in small: its pictures, its other methods, and the bounds by its judge's own formulas."""

import hashlib
from importlib.resources import files

import cv2
import numpy as np
import pytest

from procam.compensate.perceptual.settings import Perceptual
from procam.maths.vision.pu21 import pu21
from studies import picture_judge, picture_set
from studies.perceptual import hue_shift
from studies.perceptual_baselines import FlatScreen
from studies.picture_set import STORED, picture

SIZE = 96
FEEDBACK = 0.33


def small(name: str) -> np.ndarray:
    return cv2.resize(picture(name), (SIZE, SIZE), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def screen() -> FlatScreen:
    return FlatScreen(SIZE, FEEDBACK)


class TestPictures:
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
