"""The bias of one wide fringe by scattered light, on a plane whose light is known exactly."""

import numpy as np
import pytest

from procam.errors import NotEnoughData
from procam.estimate.structured_light.scatter_bias import (
    flux_share_maps,
    remove_phasor,
    remove_scatter_bias,
    scattered_light,
)
from procam.maths.codes.phase import equal_steps

SHAPE, LIT = (120, 160), np.s_[:, :80]
SHIFTS = equal_steps(8)
FLUX = 0.5 + 0.06 * np.cos(0.7 - SHIFTS)  # of each pattern, between black and white
LEVEL, BLACK = 300.0, 20.0


@pytest.fixture
def scene() -> dict[str, np.ndarray]:
    """A fringe on the left half; scattered light everywhere, less of it on the right."""
    columns = np.arange(SHAPE[1])
    phase = np.where(columns < 80, 2 * np.pi * columns / 80, 0.0)
    direct = np.zeros(SHAPE)
    direct[LIT] = LEVEL
    scattered = np.broadcast_to(100 - 0.2 * columns, SHAPE)
    frames = [
        BLACK + direct * (0.5 + 0.5 * np.cos(phase - s)) + scattered * f
        for s, f in zip(SHIFTS, FLUX, strict=True)
    ]
    lit = direct > 0
    lit[:, 80:83] = True
    return {
        "frames": np.stack(frames).astype(np.float32),
        "white": (BLACK + direct + scattered).astype(np.float32),
        "black": np.full(SHAPE, BLACK, np.float32),
        "lit": lit,
        "scattered": scattered,
        "phase": np.broadcast_to(phase, SHAPE),
    }


def biases(frames: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Errors of the phase [rad] on the lit half."""
    found = np.angle(np.tensordot(np.exp(1j * SHIFTS), frames, axes=1))[LIT]
    return np.angle(np.exp(1j * (found - phase[LIT])))


def test_flux_is_measured_on_unlit_pixels(scene: dict[str, np.ndarray]) -> None:
    levels = scene["frames"], scene["white"], scene["black"], scene["lit"]
    maps = flux_share_maps(*levels)
    np.testing.assert_allclose(maps, np.broadcast_to(FLUX[:, None, None], maps.shape), rtol=1e-5)


def test_scattered_light_and_the_bias_it_causes(scene: dict[str, np.ndarray]) -> None:
    frames, white, black = scene["frames"], scene["white"], scene["black"]
    scattered = scattered_light(frames, white, black, FLUX, SHIFTS)
    np.testing.assert_allclose(scattered, scene["scattered"], rtol=1e-4)
    assert np.abs(biases(frames, scene["phase"])).max() > 0.02
    assert np.abs(biases(remove_phasor(frames, FLUX, scattered), scene["phase"])).max() < 1e-4


@pytest.mark.parametrize("third", [-0.03, 0.03])
def test_a_response_that_keeps_black_and_white_is_seen_by_its_third_harmonic(
    scene: dict[str, np.ndarray], third: float
) -> None:
    """1/2 + (1/2 - h) cos + h cos of three times the angle is 0 at black and 1 at white."""
    columns = np.arange(SHAPE[1])
    angle = np.where(columns < 80, 2 * np.pi * columns / 80, 0.0) - SHIFTS[:, None, None]
    wave = 0.5 + (0.5 - third) * np.cos(angle) + third * np.cos(3 * angle)
    direct = np.where(columns < 80, LEVEL, 0.0)
    frames = BLACK + direct * wave + scene["scattered"] * FLUX[:, None, None]
    found = scattered_light(frames, scene["white"], scene["black"], FLUX, SHIFTS)
    np.testing.assert_allclose(found[LIT], scene["scattered"][LIT], atol=0.01 * LEVEL)


def test_lit_pixels_are_found_by_their_wave(scene: dict[str, np.ndarray]) -> None:
    frames = scene["frames"]
    amplitude = np.abs(np.tensordot(np.exp(1j * SHIFTS), frames, axes=1)) / 4
    mended = remove_scatter_bias(
        frames, scene["white"], scene["black"], amplitude.astype(np.float32), SHIFTS
    )
    assert np.abs(biases(mended, scene["phase"])).max() < 1e-3


def test_refusals(scene: dict[str, np.ndarray]) -> None:
    frames, white, black = scene["frames"], scene["white"], scene["black"]
    with pytest.raises(NotEnoughData, match="only 0 pixels of the screen have no direct light"):
        flux_share_maps(frames, white, black, np.ones(SHAPE, bool))
