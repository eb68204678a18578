"""Errors that the judge states: directions with and without a common rotation, and what can be seen."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from procam.interfaces.judge import _Pictures, _visible_errors, direction_errors
from procam.maths.geometry.sphere import normalise

ARCMIN = np.pi / 180 / 60


def test_a_common_rotation_is_no_relative_error() -> None:
    rng = np.random.default_rng(1)
    true = normalise(rng.normal(size=(2000, 3)))
    noisy = normalise(true + 0.1 * ARCMIN * rng.normal(size=true.shape))
    turned = Rotation.from_rotvec([0, 0, 3 * ARCMIN]).apply(noisy)
    absolute, relative = (np.sqrt(np.mean(e**2)) for e in direction_errors(turned, true))
    assert relative == pytest.approx(0.1 * np.sqrt(2), rel=0.05)  # noise has two directions
    assert absolute == pytest.approx(3 * np.sqrt(2 / 3), rel=0.05)  # 3 sin(angle from the axis)


TARGET, BOUNCED = 1.186, 0.2
LIT = np.arange(100).reshape(10, 10) >= 10


def visible_errors(drawn: float, black: float, spoilt: int = 0) -> dict[str, float]:
    """Of a picture that asks for direct light of 1 and gets 0.2 of bounced light where 0.186 was meant.

    `spoilt` lit pixels, and all that are not lit, are wrong by far.
    """

    def picture(light: float) -> np.ndarray:
        return np.full((10, 10, 3), light, np.float32)

    exact = picture(drawn + BOUNCED)
    exact.reshape(-1, 3)[: 10 + spoilt] = 9
    shown = {"none": picture(TARGET + 0.21), "exact": exact}
    bounced = {"none": picture(0.21), "exact": picture(BOUNCED)}
    pictures = _Pictures(picture(TARGET), picture(1.0), picture(black), shown, bounced)
    figures = _visible_errors(pictures, LIT)
    return {name.removeprefix("picture_error_jnd"): f.value for name, f in figures.items()}


@pytest.mark.parametrize(
    ("drawn", "black", "expected"),
    [
        (1.0, 0.0, {"": 0.014, "_interreflection": 0.014, "_black": 0, "_drawing": 0}),
        (1.021, 0.0, {"": 0.035, "_interreflection": 0.014, "_black": 0, "_drawing": 0.021}),
        (1.021, 1.021, {"": 0.035, "_interreflection": 0.014, "_black": 0.021, "_drawing": 0}),
    ],
)
def test_parts_of_the_visible_error(drawn: float, black: float, expected: dict[str, float]) -> None:
    found = visible_errors(drawn, black)
    assert found.pop("_before") == pytest.approx(0.21 / (0.007 * TARGET), rel=1e-3)
    jnd = {part: error / (0.007 * TARGET) for part, error in expected.items()}
    assert found == pytest.approx(jnd, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(("spoilt", "counts"), [(4, False), (5, True)])
def test_more_than_a_twentieth_of_the_lit_pixels_counts(spoilt: int, counts: bool) -> None:
    assert (visible_errors(1.0, 0.0, spoilt)[""] > 100) == counts
