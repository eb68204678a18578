"""Bands of a rolling shutter in the scattered light of a screen."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from procam.estimate.geometry.camera_view import ScreenView
from procam.estimate.light.bands import find_bands
from procam.estimate.light.spots import spot_notes

SIZE = 240


def departure(rng: np.random.Generator) -> np.ndarray:
    """Logarithm (H, W) of light of uneven paint, with noise, rings of a lens and a slope."""
    y, x = np.mgrid[-1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j]
    paint = 0.03 * np.sin(9 * x) * np.sin(7 * y) + 0.02 * y + 0.01 * np.cos(12 * np.hypot(x, y))
    return (paint + 0.02 * rng.normal(size=paint.shape)).astype(np.float32)


def circle() -> np.ndarray:
    y, x = np.mgrid[-1 : 1 : SIZE * 1j, -1 : 1 : SIZE * 1j]
    return np.hypot(x, y) < 0.9


def bands(count: float, amplitude: float) -> np.ndarray:
    """Bands (H, 1) over a picture."""
    return amplitude * np.sin(2 * np.pi * (count * np.arange(SIZE) / SIZE + 0.3))[:, None]


@pytest.mark.parametrize("count", [2.5, 6.0, 11.0])
@pytest.mark.parametrize("amplitude", [0.02, 0.1])
def test_bands_are_measured(rng: np.random.Generator, count: float, amplitude: float) -> None:
    made = bands(count, amplitude)
    rows = find_bands((departure(rng) + made).astype(np.float32), circle())
    columns = find_bands((departure(rng) + made.T).astype(np.float32), circle())
    for found, across in ((rows, 0), (columns, 1)):
        assert found is not None
        assert found.across == across
        assert found.count == pytest.approx(count, abs=0.5)
        assert found.amplitude == pytest.approx(
            amplitude, abs=0.007
        )  # at 2.5 paint's trend takes some
    assert rows is not None
    assert np.abs(rows.profile - made).max() < 0.012


def test_paint_rings_and_a_person_are_no_bands(rng: np.random.Generator) -> None:
    assert find_bands(departure(rng), circle()) is None
    somebody = departure(rng)
    somebody[80:170, 100:125] = -1.9
    assert find_bands(somebody, circle()) is None
    few = np.zeros((SIZE, SIZE), bool)
    few[100:120] = True
    assert find_bands(departure(rng), few) is None


def test_bands_are_not_called_dirt() -> None:
    y, x = (np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2) / (SIZE / 2)
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    on_screen = z > 0.3
    direction = np.stack([x, y, z], axis=-1).astype(np.float32)
    view = ScreenView(SimpleNamespace(name="zenith"), direction, on_screen, 1.0 * on_screen)
    light = (0.05 * np.exp(bands(5.0, 0.15)) * np.ones((SIZE, SIZE)))[..., None] * np.ones(3)
    (note,) = spot_notes(light.astype(np.float32), view)
    assert str(note).startswith(
        "camera zenith: rows of its photographs are brighter and darker in turn"
    )
    assert re.search(r"by 1[45]\.\d%, about 5 bands .+ set exposure_s", str(note)), note
