"""`procam session plan` and `procam decode` for every code, with photographs of the written files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from tiny_venue import procam

from procam.estimate.structured_light.codes import CODES
from procam.files.images.layers import read_channels
from procam.files.images.pixels import read_image, write_image

WIDTH, HEIGHT = 160, 100
GAMMA, BLUR_PX, NOISE_DN = 2.2, 0.5, 15.0


def _view() -> tuple[np.ndarray, np.ndarray]:
    """Projector pixels x, y that a camera of 300x240 px sees: rotated, and slightly bent."""
    v, u = np.mgrid[:240, :300].astype(float)
    x = 0.6 * u + 0.05 * v + 1e-4 * u * v - 12.0
    y = 0.5 * v - 0.04 * u + 1e-4 * v * v + 2.0
    return x, y


def _photograph(pattern: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """12-bit counts of a pattern as a screen of varying reflectance shows it, out of focus."""
    x, y = _view()
    light = np.pad(gaussian_filter((pattern / 255.0) ** GAMMA, BLUR_PX, mode="constant"), 4)
    seen = map_coordinates(light, [y + 4, x + 4], order=1, mode="constant")
    counts = 80 + 2800 * seen * (1 + 0.1 * np.sin(x / 40)) + rng.normal(0, NOISE_DN, x.shape)
    return np.rint(np.clip(counts, 0, 4095)).astype(np.uint16)


@pytest.mark.parametrize("code", CODES)
def test_patterns_photographed_and_decoded(code: str, tmp_path: Path) -> None:
    size = ("--size", f"{WIDTH}x{HEIGHT}", "--code", code)
    assert procam("lens", "patterns", tmp_path / "patterns", *size).code == 0
    rng = np.random.default_rng(7)
    photos = tmp_path / "photos"
    photos.mkdir()
    for path in sorted((tmp_path / "patterns").iterdir()):
        write_image(photos / path.name, _photograph(read_image(path)[..., 0], rng))
    ran = procam("decode", photos, *size, tmp_path / "map.exr")
    assert (ran.code, ran.err) == (0, "")
    found = read_channels(tmp_path / "map.exr")
    x, y = _view()
    inside = (x > 4) & (x < WIDTH - 5) & (y > 4) & (y < HEIGHT - 5)
    valid = np.isfinite(found["sigma"])
    assert valid[inside].mean() > (0.9 if "phase" in code else 0.7)
    assert not valid[(x < -2) | (y < -2) | (x > WIDTH + 1) | (y > HEIGHT + 1)].any()
    both = inside & valid
    for name, truth in (("x", x), ("y", y)):
        error = (found[f"projector.{name}"] - truth)[both]
        assert np.mean(np.abs(error) > 1.5) < 2e-3
        score = (error / found["sigma"][both])[np.abs(error) < 1.5]
        assert np.sqrt(np.mean(score**2)) < 1.5
