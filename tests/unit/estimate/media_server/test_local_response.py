"""Local exponents of a response, from light made with other curves."""

import numpy as np

from procam.estimate.media_server.local_response import fit_exponent, level_samples
from procam.estimate.structured_light.patterns import LEVELS
from procam.model.photometry import ResponseCurve

SIZE, PHOTO = 200, 160
GRID = np.linspace(0, 1, 257)
RESPONSE = ResponseCurve(GRID, np.stack([GRID**2.2] * 3, 1), np.zeros((257, 3)))
MIX = np.array([[0.9, 0.08, 0.02], [0.05, 0.9, 0.05], [0.0, 0.1, 0.9]])


def photographed(gamma: np.ndarray, seen: np.ndarray) -> tuple[list, np.ndarray, np.ndarray]:
    """Two level pictures of a master whose gamma is `gamma` (H, W, 3) where a camera pixel looks."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:PHOTO, :PHOTO] * (SIZE / PHOTO)
    places = np.stack([x, y], -1).astype(np.float32)
    white = (2.0 + x / SIZE)[..., None] * MIX.sum(axis=1)
    pictures = []
    for _ in range(2):
        tiles = rng.integers(0, len(LEVELS), (40, 40)).repeat(4, 0).repeat(4, 1)
        drive = np.array(LEVELS)[tiles] / 255
        light = white / MIX.sum(axis=1) * (drive[..., None] ** gamma @ MIX.T)
        light *= 1 + rng.normal(0, 0.005, light.shape)
        pictures.append((light.astype(np.float32), np.where(seen, tiles, -1)))
    return pictures, white.astype(np.float32), places


def test_exponents_per_primary_and_position() -> None:
    across = np.linspace(-1, 1, PHOTO)[None, :, None]
    gamma = 2.2 * (1 + across * np.array([0.05, -0.03, 0.0])) * np.ones((PHOTO, 1, 1))
    pictures, white, places = photographed(gamma, np.ones((PHOTO, PHOTO), bool))
    found = fit_exponent(level_samples(pictures, white, MIX, places, SIZE), RESPONSE, SIZE)
    assert found.shape == (SIZE, SIZE, 3)
    wanted = gamma[::4, ::4] / 2.2
    inner = np.s_[15:-15, 15:-15]  # at the border the slope of what is fitted is cut off
    off = found[2::5, 2::5][inner] - wanted[inner]
    assert np.abs(off).max() < 0.01
    assert np.sqrt(np.mean(off**2)) < 0.003


def test_unseen_positions_get_exponent_1() -> None:
    seen = np.zeros((PHOTO, PHOTO), bool)
    seen[:, : PHOTO // 4] = True
    pictures, white, places = photographed(np.full((PHOTO, PHOTO, 3), 2.31), seen)
    found = fit_exponent(level_samples(pictures, white, MIX, places, SIZE), RESPONSE, SIZE)
    np.testing.assert_allclose(found[:, : SIZE // 6], 1.05, atol=0.01)
    np.testing.assert_array_equal(found[:, SIZE // 2 :], 1.0)
