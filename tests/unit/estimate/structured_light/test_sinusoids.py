"""Sinusoidal pictures to columns, with samples missing."""

import numpy as np
import pytest
from tolerances import SIGMAS

from procam.estimate.structured_light.self_calibration import SinusoidImages
from procam.estimate.structured_light.sinusoids import complete_base_set, decode_sinusoids
from procam.maths.codes.phase import micro_waves

LENGTH, SHAPE, NOISE = 960, (30, 80), 0.5
WAVES = micro_waves((LENGTH, 600))


@pytest.fixture
def columns(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(0, LENGTH - 1, SHAPE)


def photographs(
    columns: np.ndarray, rng: np.random.Generator, noise: float = NOISE
) -> list[np.ndarray]:
    angle = 2 * np.pi * columns[..., None] / WAVES.periods - WAVES.shifts
    samples = 200 + 80 * np.cos(angle) + rng.normal(0, noise, angle.shape)
    return [s.astype(np.float32) for s in np.moveaxis(samples, -1, 0)]


def images(frames: list[np.ndarray], dropped: list[np.ndarray]) -> SinusoidImages:
    span, usable = np.full(SHAPE, 160, np.float32), np.ones(SHAPE, bool)
    return SinusoidImages(frames, WAVES, LENGTH, span, usable, dropped)


def test_columns_lie_within_their_sigmas(columns: np.ndarray, rng: np.random.Generator) -> None:
    frames = photographs(columns, rng)
    found = decode_sinusoids(images(frames, [np.zeros(SHAPE, bool)] * len(frames)))
    error = (found.x - columns) / found.sigma
    assert np.mean(error**2) == pytest.approx(1, abs=0.1)
    assert np.median(found.amplitude) == pytest.approx(80, rel=0.01)
    assert found.noise.variance(200) == pytest.approx(NOISE**2, rel=0.05)


def test_few_wrong_fringes_are_trusted(columns: np.ndarray, rng: np.random.Generator) -> None:
    """Noise of a tenth of the amplitude leads one pixel in 200 to another fringe."""
    wrong = trusted = 0
    for _ in range(4):
        frames = photographs(columns, rng, noise=8.0)
        found = decode_sinusoids(images(frames, [np.zeros(SHAPE, bool)] * len(frames)))
        wrong += int((np.abs(found.x - columns) > WAVES.periods[0] / 2).sum())
        trusted += int(np.isfinite(found.x).sum())
    assert trusted > 0.97 * 4 * columns.size
    assert wrong < 0.0025 * trusted


def test_dropped_samples(columns: np.ndarray, rng: np.random.Generator) -> None:
    """One lost sample per pixel in one part, four in another: five samples are the least."""
    frames = photographs(columns, rng)
    dropped = [np.zeros(SHAPE, bool) for _ in frames]
    dropped[6][:10, :20] = True
    for mask in dropped[:4]:
        mask[20:, :20] = True
    found = decode_sinusoids(images(frames, dropped))
    error = np.abs(found.x - columns) / found.sigma
    assert error[:10, :20].max() < SIGMAS + 1
    assert np.isnan(found.x[20:, :20]).all()
    assert np.isfinite(found.x[:, 20:]).all()


def test_a_lost_picture_of_the_base_set(columns: np.ndarray, rng: np.random.Generator) -> None:
    frames = dict(enumerate(photographs(columns, rng)))
    white, black = np.full(SHAPE, 280, np.float32), np.full(SHAPE, 120, np.float32)
    whole = complete_base_set({k: f for k, f in frames.items() if k != 1}, WAVES, white, black)
    assert np.abs(whole[1] - frames[1]).max() < 2 * SIGMAS * NOISE
    two_lost = {k: f for k, f in frames.items() if k > 1}
    assert complete_base_set(two_lost, WAVES, white, black) is two_lost
