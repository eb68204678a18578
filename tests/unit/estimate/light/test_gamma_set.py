"""The response of a projector from flat grey levels of known noise."""

import numpy as np
import pytest
from tolerances import CLOSED_FORM, SIGMAS

from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.light.gamma_set import fit_gamma_set

DRIVES = (0, 40, 80, 128, 190, 255)
SHADE = np.linspace(0.2, 0.9, 64 * 96).reshape(64, 96, 1)
NOISE = 0.02


def photographs(seed: int, gamma: float = 2.2) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    clean = [0.01 + SHADE * (drive / 255) ** gamma for drive in DRIVES]
    return [light + NOISE * rng.normal(size=light.shape) for light in clean]


def test_the_curve_without_noise() -> None:
    light = [0.01 + SHADE * (drive / 255) ** 2.2 for drive in DRIVES]
    curve = fit_gamma_set(light[::-1], DRIVES[::-1])
    np.testing.assert_allclose(curve.values[:, 0], curve.levels**2.2, atol=1e-3)
    np.testing.assert_allclose(curve.values[[0, -1]], [[0] * 3, [1] * 3], atol=CLOSED_FORM)


def test_standard_errors_are_the_spread_over_seeds() -> None:
    curves = [fit_gamma_set(photographs(seed), DRIVES) for seed in range(40)]
    at = round(256 * 128 / 255)
    spread = np.std([curve.values[at, 0] for curve in curves])
    sigma = np.mean([curve.sigma[at, 0] for curve in curves])
    # the relative error of a standard deviation of 40 is 1/sqrt(78)
    assert abs(sigma / spread - 1) < SIGMAS / np.sqrt(78)


@pytest.mark.parametrize("drives", [(1, 40, 80, 128, 190, 255), (0, 40, 40, 128, 190, 255)])
def test_levels_without_black_or_twice(drives: tuple[int, ...]) -> None:
    with pytest.raises(NotEnoughData, match="each level once is needed, with 0 and 255"):
        fit_gamma_set(photographs(0), drives)


def test_a_saturated_white() -> None:
    light = photographs(0)
    light[-1][:] = np.nan
    with pytest.raises(NotEnoughData, match=r"0 of \d+ squares of the picture are lit"):
        fit_gamma_set(light, DRIVES)


def test_light_that_falls() -> None:
    light = photographs(0)
    light[3], light[4] = light[4], light[3]
    with pytest.raises(OutOfModelRange, match=r"light falls by 3\d\.\d% of white above drive 128"):
        fit_gamma_set(light, DRIVES)
