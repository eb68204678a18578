"""The dither thresholds, and the program that made them (void and cluster)."""

import numpy as np
import pytest

from procam.maths.codes.dither import TILE, threshold_tile

SIGMA_PX = 1.5
START = 10  # one pixel in so many is set in the initial pattern
SEED = 1  # of the stored tile


def stored_ranks() -> np.ndarray:
    return np.rint(threshold_tile() * TILE**2 - 0.5).astype(int)


@pytest.mark.parametrize("ranks", [stored_ranks, lambda: void_and_cluster(TILE, SEED)])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_every_level_is_noise_of_high_frequency(ranks: object, share: float) -> None:
    """Against white noise, whose power is that of the level at every frequency."""
    level = ranks() < share * TILE**2  # type: ignore[operator]
    power = np.abs(np.fft.fft2(level - level.mean())) ** 2 / TILE**2 / (share * (1 - share))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(TILE), np.fft.fftfreq(TILE)))
    assert power[frequency < 0.1].mean() < 0.05
    assert power[frequency > 0.3].mean() > 1


def test_every_threshold_occurs_once() -> None:
    assert sorted(stored_ranks().ravel()) == list(range(TILE**2))
    assert threshold_tile().dtype == np.float32


def void_and_cluster(size: int, seed: int) -> np.ndarray:
    """Ranks 0..size^2 - 1 (size, size), each as far as possible from the lower ones."""
    blob = _blob(size)
    on = _spread_start(size, blob, np.random.default_rng(seed))
    ranks = np.zeros((size, size), np.uint16)
    count = int(on.sum())
    energy, left = _energy(on, blob), on.copy()
    for rank in reversed(range(count)):  # remove the tightest cluster
        place = _argmax(energy, left)
        left[place] = False
        energy -= np.roll(blob, place, (0, 1))
        ranks[place] = rank
    energy, filled = _energy(on, blob), on.copy()
    for rank in range(count, size * size):  # fill the largest void
        place = _argmax(-energy, ~filled)
        filled[place] = True
        energy += np.roll(blob, place, (0, 1))
        ranks[place] = rank
    return ranks


def _blob(size: int) -> np.ndarray:
    """Gaussian (size, size) around pixel (0, 0), periodic across the edges."""
    away = np.minimum(np.arange(size), size - np.arange(size))
    return np.exp(-(away[:, None] ** 2 + away**2) / (2 * SIGMA_PX**2))


def _spread_start(size: int, blob: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random pixels, moved from clusters to voids until none moves."""
    on = (rng.permutation(size * size) < size * size // START).reshape(size, size)
    energy = _energy(on, blob)
    while True:
        crowded = _argmax(energy, on)
        on[crowded] = False
        energy -= np.roll(blob, crowded, (0, 1))
        empty = _argmax(-energy, ~on)
        on[empty] = True
        energy += np.roll(blob, empty, (0, 1))
        if empty == crowded:
            return on


def _energy(on: np.ndarray, blob: np.ndarray) -> np.ndarray:
    spectrum = np.fft.rfft2(on) * np.fft.rfft2(blob)
    return np.asarray(np.fft.irfft2(spectrum, on.shape))


def _argmax(energy: np.ndarray, among: np.ndarray) -> tuple[int, int]:
    place = int(np.argmax(np.where(among, energy, -np.inf)))
    return divmod(place, energy.shape[1])
