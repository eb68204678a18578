"""The veil near its light, from stripes whose veil SciPy draws."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procam.estimate.camera.local_veil import SPREADS, LocalVeilFit, spread_light

SIZE = (240, 200)  # width, height
SHARE, SCATTERED = 0.006, 0.25


def _stripes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Pictures (H, W) of direct light, and where the projector's picture is dark."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    inside = (abs(x - 120) < 90) & (abs(y - 100) < 70)
    pictures = []
    for place, half in ((x, 16), (x, 32), (y, 16), (y, 32)):
        bright = (place // half) % 2 == 0
        pictures += [(inside * bright * 1.0, inside & ~bright), (inside * ~bright, inside & bright)]
    return pictures


def _fitted(share: float, spread: float, rng: np.random.Generator) -> tuple[float, float]:
    seen = np.ones(SIZE[::-1], bool)
    fit = LocalVeilFit(seen)
    white = sum(picture for picture, _ in _stripes()[:2])
    for level in (1.0, 2.0):  # two projectors
        for picture, dark in _stripes():
            flux = picture.sum() / white.sum()
            light = level * (picture + SCATTERED * flux)
            near = gaussian_filter(light, spread * SIZE[1], mode="constant")
            light = light + share * (near - light.mean()) + rng.normal(0, 1e-3, light.shape)
            fit.add(light.astype(np.float32), dark, flux)
        fit.end_projector()
    return fit.result()


@pytest.mark.parametrize("spread", [0.04, 0.1])
def test_finds_the_veil_between_stripes(rng: np.random.Generator, spread: float) -> None:
    share, found = _fitted(SHARE, spread, rng)
    assert found == spread
    assert share == pytest.approx(SHARE, rel=0.1)


def test_a_veil_between_the_spreads_takes_the_same_light(rng: np.random.Generator) -> None:
    """What matters is the light in the stripes, not how share and spread divide it."""
    share, found = _fitted(SHARE, 0.048, rng)
    assert found in (0.04, 0.055)
    near, like = (
        np.concatenate(
            [s * (spread_light(p.astype(np.float32), w) - p.mean())[d] for p, d in _stripes()]
        )
        for s, w in ((SHARE, 0.048), (share, found))
    )
    assert np.std(like - near) < 0.15 * np.std(near)


def test_none_is_found_where_there_is_none(rng: np.random.Generator) -> None:
    assert _fitted(0.0, 0.055, rng)[0] < 3e-4


def test_too_little_to_compare() -> None:
    fit = LocalVeilFit(np.ones((40, 40), bool))
    fit.add(np.ones((40, 40), np.float32), np.eye(40, dtype=bool), 0.5)
    fit.end_projector()
    assert fit.result() == (0.0, 0.0)


def test_spread_light_is_a_gaussian_that_loses_what_leaves_the_picture() -> None:
    light = np.zeros((200, 240, 2), np.float32)
    light[80:120, 100:140, 0] = 1
    light[:, :, 1] = 1
    soft = spread_light(light, SPREADS[2])
    expected = gaussian_filter(light, (SPREADS[2] * 200, SPREADS[2] * 200, 0), mode="constant")
    inner = slice(8, -8)  # cells are coarse
    np.testing.assert_allclose(soft[inner, inner], expected[inner, inner], atol=0.01)
    assert soft[0, 0, 1] == pytest.approx(0.25, abs=0.08)
