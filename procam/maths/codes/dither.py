"""Blue noise: where to round up, so that steps of 8 bits do not show as bands."""

from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

TILE = 64
STORED = "blue_noise.npz"
SIGMA_PX = 1.5
START = 10  # every so many pixels is set at first


@cache
def threshold_tile() -> NDArray[np.float32]:
    """Thresholds (64, 64) in 0..1 whose every level is spread evenly; repeats without a seam.

    floor(value + threshold) is value on average, and what is left is noise of high frequency
    (void and cluster: Ulichney 1993, doi:10.1117/12.152707). Made by `void_and_cluster`.
    """
    with files("procam.maths.codes").joinpath(STORED).open("rb") as file, np.load(file) as stored:
        return ((stored["ranks"] + np.float32(0.5)) / TILE**2).astype(np.float32)


def void_and_cluster(size: int, seed: int) -> NDArray[np.uint16]:
    """Ranks 0..size^2 - 1 (size, size), each as far as can be from those before."""
    blob = _blob(size)
    on = _even_start(size, blob, np.random.default_rng(seed))
    ranks = np.zeros((size, size), np.uint16)
    count = int(on.sum())
    energy, left = _energy(on, blob), on.copy()
    for rank in reversed(range(count)):  # take off the most crowded
        place = _most(energy, left)
        left[place] = False
        energy -= np.roll(blob, place, (0, 1))
        ranks[place] = rank
    energy, filled = _energy(on, blob), on.copy()
    for rank in range(count, size * size):  # fill the emptiest
        place = _most(-energy, ~filled)
        filled[place] = True
        energy += np.roll(blob, place, (0, 1))
        ranks[place] = rank
    return ranks


def _blob(size: int) -> NDArray[np.float64]:
    """What a pixel at (0, 0) adds to the crowd at each other one, round the edges."""
    away = np.minimum(np.arange(size), size - np.arange(size))
    return np.exp(-(away[:, None] ** 2 + away**2) / (2 * SIGMA_PX**2))


def _even_start(
    size: int, blob: NDArray[np.float64], rng: "np.random.Generator"
) -> NDArray[np.bool_]:
    """Random pixels, moved from clusters to voids until nothing moves any more."""
    on = (rng.permutation(size * size) < size * size // START).reshape(size, size)
    energy = _energy(on, blob)
    while True:
        crowded = _most(energy, on)
        on[crowded] = False
        energy -= np.roll(blob, crowded, (0, 1))
        empty = _most(-energy, ~on)
        on[empty] = True
        energy += np.roll(blob, empty, (0, 1))
        if empty == crowded:
            return on


def _energy(on: NDArray[np.bool_], blob: NDArray[np.float64]) -> NDArray[np.float64]:
    spectrum = np.fft.rfft2(on) * np.fft.rfft2(blob)
    return np.asarray(np.fft.irfft2(spectrum, on.shape))


def _most(energy: NDArray[np.float64], among: NDArray[np.bool_]) -> tuple[int, int]:
    place = int(np.argmax(np.where(among, energy, -np.inf)))
    return divmod(place, energy.shape[1])
