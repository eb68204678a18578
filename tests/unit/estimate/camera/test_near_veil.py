"""The veil near its light, from stripes whose veil SciPy draws."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procam.estimate.camera.near_veil import SPREADS, NearVeilFit, near_veil

SIZE = (240, 200)  # width, height
SCATTERED = 0.25
Parts = list[tuple[float, float]]


def _stripes() -> list[tuple[np.ndarray, np.ndarray]]:
    """Pictures (H, W) of direct light, and where the projector's picture is dark."""
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    inside = (abs(x - 120) < 90) & (abs(y - 100) < 70)
    pictures = []
    for place, half in ((x, 16), (x, 32), (y, 16), (y, 32)):
        bright = (place // half) % 2 == 0
        pictures += [(inside * bright * 1.0, inside & ~bright), (inside * ~bright, inside & bright)]
    return pictures


def _veil(light: np.ndarray, parts: Parts) -> np.ndarray:
    spread = (s * gaussian_filter(light, w * SIZE[1], mode="constant") for s, w in parts)
    return sum(spread, np.zeros_like(light))


def _fitted(parts: Parts, rng: np.random.Generator, columns: int = 240) -> Parts:
    """The fit to what is dark in the first columns."""
    fit = NearVeilFit(np.ones(SIZE[::-1], bool))
    white = sum(picture for picture, _ in _stripes()[:2])
    for level in (1.0, 2.0):  # two projectors
        for number, (picture, dark) in enumerate(_stripes()):
            flux = picture.sum() / white.sum()
            light = level * (picture + SCATTERED * flux)
            share = sum(s for s, _ in parts)
            seen = light + _veil(light, parts) - share * light.mean()
            noisy = (seen + rng.normal(0, 1e-3, light.shape)).astype(np.float32)
            fit.add(noisy, dark & (np.arange(SIZE[0]) < columns), flux)
            if number % 4 == 3:  # stripes of one axis
                fit.end_group()
    return fit.result()


@pytest.mark.parametrize(
    "parts", [[(0.006, 0.03)], [(0.006, 0.05)], [(0.002, 0.025), (0.002, 0.05), (0.002, 0.09)]]
)
def test_finds_the_veil_in_dark_stripes(rng: np.random.Generator, parts: Parts) -> None:
    """What matters is the light in the stripes, not how Gaussians share it out."""
    found = _fitted(parts, rng)
    assert sum(s for s, _ in found) == pytest.approx(0.006, rel=0.15)
    veil, like = (
        np.concatenate(
            [(_veil(p, each) - sum(s for s, _ in each) * p.mean())[d] for p, d in _stripes()]
        )
        for each in (parts, found)
    )
    assert np.std(like - veil) < 0.15 * np.std(veil)


def test_none_is_found_where_there_is_none(rng: np.random.Generator) -> None:
    assert sum(s for s, _ in _fitted([], rng)) < 3e-4


def test_light_that_comes_back_widely_is_no_veil_of_the_lens(rng: np.random.Generator) -> None:
    assert sum(s for s, _ in _fitted([(0.006, SPREADS[-1])], rng)) < 6e-4


def test_a_trace_of_blurred_light_beside_the_dark_is_no_veil(rng: np.random.Generator) -> None:
    """What a projector's lens spreads a few pixels beyond a stripe."""
    fit = NearVeilFit(np.ones(SIZE[::-1], bool))
    for number, (picture, dark) in enumerate(_stripes()):
        blurred = 0.99 * picture + 0.01 * gaussian_filter(picture, 2.0)
        seen = blurred + SCATTERED * 0.5 + rng.normal(0, 1e-3, picture.shape)
        fit.add(seen.astype(np.float32), dark, 0.5)
        if number % 4 == 3:
            fit.end_group()
    assert sum(s for s, _ in fit.result()) < 3e-4


def test_too_little_to_compare() -> None:
    fit = NearVeilFit(np.ones((40, 40), bool))
    fit.add(np.ones((40, 40), np.float32), np.eye(40, dtype=bool), 0.5)
    fit.end_group()
    assert fit.result() == []


def test_one_axis_of_one_projector_shows_none(rng: np.random.Generator) -> None:
    fit = NearVeilFit(np.ones(SIZE[::-1], bool))
    for picture, dark in _stripes():
        seen = picture + _veil(picture, [(0.006, 0.045)])
        fit.add((seen + rng.normal(0, 1e-3, seen.shape)).astype(np.float32), dark, 0.5)
    fit.end_group()
    assert fit.result() == []


def test_near_veil_is_a_sum_of_gaussians_that_lose_what_leaves_the_picture() -> None:
    light = np.zeros((200, 240, 2), np.float32)
    light[80:120, 100:140, 0] = 1
    light[:, :, 1] = 1
    parts = [(0.5, 0.05), (0.25, 0.1)]
    soft = near_veil(light, parts)
    expected = sum(
        s * gaussian_filter(light, (w * 200, w * 200, 0), mode="constant") for s, w in parts
    )
    inner = slice(8, -8)  # cells are coarse
    np.testing.assert_allclose(soft[inner, inner], expected[inner, inner], atol=0.01)
    assert soft[0, 0, 1] == pytest.approx(0.75 / 4, abs=0.06)


def test_none_is_found_where_the_axes_contradict_each_other(rng: np.random.Generator) -> None:
    """What only stripes of one axis show, such as light that a floor returns, is no veil of the lens."""
    fit = NearVeilFit(np.ones(SIZE[::-1], bool))
    for number, (picture, dark) in enumerate(_stripes()):
        seen = picture + (_veil(picture, [(0.006, 0.045)]) if number < 4 else 0)
        fit.add((seen + rng.normal(0, 1e-3, seen.shape)).astype(np.float32), dark, 0.5)
        if number % 4 == 3:
            fit.end_group()
    assert fit.result() == []


def test_a_few_dark_cells_show_nothing(rng: np.random.Generator) -> None:
    """Of a picture of 64 pixels, however clear the veil."""
    fit = NearVeilFit(np.ones(SIZE[::-1], bool))
    white = sum(picture for picture, _ in _stripes()[:2])
    for picture, dark in _stripes():
        few = np.zeros_like(dark)
        few[80:112, 80:112] = dark[80:112, 80:112]
        light = picture + SCATTERED * picture.sum() / white.sum()
        seen = light + _veil(light, [(0.006, 0.03)]) - 0.006 * light.mean()
        fit.add(seen.astype(np.float32), few, picture.sum() / white.sum())
        fit.end_group()
    assert fit.result() == []


@pytest.mark.parametrize("seed", range(4))
def test_few_dark_cells_show_no_veil(seed: int) -> None:
    """Over a narrow strip what comes back from the room varies like a veil."""
    assert _fitted([(0.006, 0.03)], np.random.default_rng(seed), 60) == []
