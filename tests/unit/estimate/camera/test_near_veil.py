"""The veil near its light, from stripes whose veil SciPy draws."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procam.estimate.camera.veil import SPREADS, NearVeilFit, near_veil

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


def _fitted(
    parts: Parts,
    rng: np.random.Generator,
    *,
    dark_within: np.ndarray | None = None,
    stripes: slice = slice(None),
    levels: tuple[float, ...] = (1.0, 2.0),
    group: int = 4,
) -> Parts:
    """The fit to what is dark in a part of the picture, with the veil in some of the stripes.

    Stripes of `group` pictures, those of one axis, are compared with each other; there is a projector
    for each of `levels`.
    """
    fit = NearVeilFit(np.ones(SIZE[::-1], bool))
    white = sum(picture for picture, _ in _stripes()[:2])
    veiled = range(8)[stripes]
    for level in levels:
        for number, (picture, dark) in enumerate(_stripes()):
            flux = picture.sum() / white.sum()
            light = level * (picture + SCATTERED * flux)
            veil = parts if number in veiled else []
            seen = light + _veil(light, veil) - sum(s for s, _ in veil) * light.mean()
            noisy = (seen + rng.normal(0, 1e-3, light.shape)).astype(np.float32)
            fit.add(noisy, dark if dark_within is None else dark & dark_within, flux)
            if number % group == group - 1:
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


def test_stripes_that_are_not_compared_show_none(rng: np.random.Generator) -> None:
    """Both axes of one projector taken for one."""
    assert _fitted([(0.006, 0.045)], rng, levels=(1.0,), group=8) == []


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
    assert _fitted([(0.006, 0.045)], rng, levels=(1.0,), stripes=slice(4)) == []


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (slice(80, 112), slice(80, 112)),  # of a picture of 64 pixels, however clear the veil
        (
            slice(None),
            slice(60),
        ),  # over a narrow strip what comes back from the room varies like a veil
    ],
)
def test_few_dark_cells_show_no_veil(rows: slice, columns: slice, rng: np.random.Generator) -> None:
    within = np.zeros(SIZE[::-1], bool)
    within[rows, columns] = True
    assert _fitted([(0.006, 0.03)], rng, dark_within=within) == []
