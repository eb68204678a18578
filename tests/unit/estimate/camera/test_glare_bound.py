"""A glare of 0 that nobody can have measured, bounded by the darkest place in a photograph."""

from dataclasses import replace

import numpy as np
import pytest

from procam.estimate.camera.veil import (
    MOST,
    UNIFORM,
    bounded_glare,
    darkest_share,
    glare_notes,
)
from procam.model.optics import Sensor

SURE = Sensor(12, 64.0, glare=0.0, glare_sigma=1e-4)


def veiled(glare: float, rng: np.random.Generator) -> np.ndarray:
    """A bright picture with a black corner, behind a veil, with noise."""
    light = np.ones((80, 80))
    light[:16, :16] = 0
    seen = (1 - glare) * light + glare * light.mean()
    return (seen + 1e-3 * rng.normal(size=seen.shape)).astype(np.float32)


@pytest.mark.parametrize("glare", [0.0, 0.01, 0.04])
def test_the_darkest_place_shows_the_veil(rng: np.random.Generator, glare: float) -> None:
    seen = np.ones((80, 80), bool)
    assert darkest_share(veiled(glare, rng), seen) == pytest.approx(glare, abs=1.2e-3)
    assert darkest_share(np.zeros((80, 80), np.float32), seen) == MOST
    assert darkest_share(veiled(glare, rng), ~seen) == MOST


def test_zero_is_not_known_better_than_the_darkest_place_allows() -> None:
    bounded = bounded_glare(SURE, 0.03)
    assert bounded.glare_sigma == pytest.approx(0.03 / np.sqrt(3))
    assert 0.03 < 1.96 * bounded.glare_sigma  # all of it may be veil
    assert bounded_glare(SURE, 1.0).glare_sigma == pytest.approx(MOST * UNIFORM)
    (note,) = glare_notes("zenith", SURE, bounded, 0.03)
    assert "glare_sigma = 0.0001, but" in str(
        note
    ) and "darkest place in its pictures has 3.0%" in str(note)


@pytest.mark.parametrize(
    "sensor",
    [
        replace(SURE, glare=0.003),  # somebody measured it
        replace(SURE, glare_sigma=0.01),  # nobody claims to know
        replace(SURE, glare_sigma=0.009),  # is as wide as the bound, nearly
    ],
)
def test_what_is_stated_is_trusted(sensor: Sensor) -> None:
    assert bounded_glare(sensor, 0.03) is sensor
    assert glare_notes("zenith", sensor, sensor, 0.03) == []


def test_a_black_place_confirms_zero() -> None:
    assert bounded_glare(replace(SURE, glare_sigma=0.0), 0.0).glare_sigma == 0.0
