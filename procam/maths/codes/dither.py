"""Dither thresholds of blue noise, so that rounding to 8 bits leaves no visible bands.

Void and cluster (Ulichney 1993, doi:10.1117/12.152707): of a tile of pixels, those of each rank are
spread as evenly as possible, because each pixel is added in the largest void, or removed from the
tightest cluster, of a Gaussian-filtered pattern. The ranks of the tile in use are stored.
"""

from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

TILE = 64
STORED = "blue_noise.npz"
SIGMA_PX = 1.5
START = 10  # one pixel in so many is set in the initial pattern


@cache
def threshold_tile() -> NDArray[np.float32]:
    """Thresholds (64, 64) in 0..1 for rounding, made by `void_and_cluster`; the tile repeats seamlessly.

    floor(value + threshold) is the value on average, and the error is noise of high frequency.
    """
    with files("procam.maths.codes").joinpath(STORED).open("rb") as file, np.load(file) as stored:
        return ((stored["ranks"] + np.float32(0.5)) / TILE**2).astype(np.float32)


def void_and_cluster(size: int, seed: int) -> NDArray[np.uint16]:
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


def _blob(size: int) -> NDArray[np.float64]:
    """Gaussian (size, size) around pixel (0, 0), periodic across the edges."""
    away = np.minimum(np.arange(size), size - np.arange(size))
    return np.exp(-(away[:, None] ** 2 + away**2) / (2 * SIGMA_PX**2))


def _spread_start(
    size: int, blob: NDArray[np.float64], rng: "np.random.Generator"
) -> NDArray[np.bool_]:
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


def _energy(on: NDArray[np.bool_], blob: NDArray[np.float64]) -> NDArray[np.float64]:
    spectrum = np.fft.rfft2(on) * np.fft.rfft2(blob)
    return np.asarray(np.fft.irfft2(spectrum, on.shape))


def _argmax(energy: NDArray[np.float64], among: NDArray[np.bool_]) -> tuple[int, int]:
    place = int(np.argmax(np.where(among, energy, -np.inf)))
    return divmod(place, energy.shape[1])
