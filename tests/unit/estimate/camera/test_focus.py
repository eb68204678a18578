"""The blur of stripes' edges."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from procam.estimate.camera.checks import edge_blur

STRIPES = np.arange(200)[None, :] // 40 % 2 * np.ones((300, 1))


@pytest.mark.parametrize(
    ("blur_px", "scatter", "empty_rows"),
    [
        (1.0, 0.0, 0),
        (2.0, 0.2, 0),
        (4.0, 0.2, 0),
        (1.0, 0.2, 600),  # a large part with scattered light alone
        (1.0, np.linspace(0, 1, 300)[:, None], 0),  # that differs from place to place
    ],
)
def test_blur_of_stripes(
    blur_px: float, scatter: float | np.ndarray, empty_rows: int, rng: np.random.Generator
) -> None:
    def seen(picture: np.ndarray, flux: float) -> np.ndarray:
        light = np.pad(gaussian_filter(picture, blur_px), ((0, empty_rows), (0, 0)))
        light = light + scatter * flux
        return (light + rng.normal(0, 0.003, light.shape)).astype(np.float32)

    white = seen(np.ones_like(STRIPES), 1.0)
    found = edge_blur(seen(STRIPES, 0.5), seen(1 - STRIPES, 0.5), white)
    assert found == pytest.approx(np.hypot(blur_px, 0.7), rel=0.15)  # the slope spans two pixels


def test_no_edges() -> None:
    flat = np.ones((50, 60), np.float32)
    assert np.isnan(edge_blur(flat, 0 * flat, flat))
