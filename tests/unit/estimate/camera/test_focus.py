"""The blur of stripes' edges."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procam.estimate.camera.focus import edge_blur


@pytest.mark.parametrize("blur_px", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("scatter", [0.0, 0.2])
def test_blur_of_stripes(blur_px: float, scatter: float, rng: np.random.Generator) -> None:
    stripes = (np.arange(200)[None, :] // 40 % 2) * np.ones((120, 1))

    def seen(picture: np.ndarray) -> np.ndarray:
        light = gaussian_filter(picture, blur_px) + scatter * 0.5
        return (light + rng.normal(0, 0.003, light.shape)).astype(np.float32)

    white = (np.ones((120, 200)) + scatter).astype(np.float32)
    found = edge_blur(seen(stripes), seen(1 - stripes), white)
    assert found == pytest.approx(np.hypot(blur_px, 0.7), rel=0.15)  # the slope spans two pixels


def test_a_large_part_with_scattered_light_alone(rng: np.random.Generator) -> None:
    stripes = (np.arange(200)[None, :] // 40 % 2) * np.ones((120, 1))

    def seen(picture: np.ndarray) -> np.ndarray:
        light = np.pad(gaussian_filter(picture, 1.0), ((0, 300), (0, 0))) + 0.2
        return (light + rng.normal(0, 0.003, light.shape)).astype(np.float32)

    white = np.pad(np.full((120, 200), 1.0), ((0, 300), (0, 0))) + 0.4
    found = edge_blur(seen(stripes), seen(1 - stripes), white.astype(np.float32))
    assert found == pytest.approx(np.hypot(1.0, 0.7), rel=0.15)


def test_scattered_light_that_differs_from_place_to_place(rng: np.random.Generator) -> None:
    stripes = (np.arange(200)[None, :] // 40 % 2) * np.ones((300, 1))
    scatter = np.linspace(0, 1, 300)[:, None]

    def seen(picture: np.ndarray) -> np.ndarray:
        light = gaussian_filter(picture, 1.0) + scatter / 2
        return (light + rng.normal(0, 0.003, light.shape)).astype(np.float32)

    white = (np.ones((300, 200)) + scatter).astype(np.float32)
    found = edge_blur(seen(stripes), seen(1 - stripes), white)
    assert found == pytest.approx(np.hypot(1.0, 0.7), rel=0.15)


def test_no_edges() -> None:
    flat = np.ones((50, 60), np.float32)
    assert np.isnan(edge_blur(flat, 0 * flat, flat))
