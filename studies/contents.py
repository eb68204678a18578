"""Contents that studies try a dome with: those of `workflows.sample_content`, and harder ones."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial import cKDTree

from procam.arrays import Image
from procam.maths.geometry.sphere import angles_from_direction, master_directions, normalise
from procam.workflows.sample_content import drawn, half_sky, interior, over, sky, soft_step, white

SQUARE = np.radians(3.0)
STARS = 500
STAR_SIGMA = np.radians(0.3)


def left_right(size: int) -> Image:
    """Day on the left half of the dome, dusk on the right: (N, N, 3) linear.

    The most one-sided of pictures: one scalar for all scattered light misses what a floor returns.
    """
    direction, inside = master_directions(size)
    _, elevation = angles_from_direction(direction)
    height = np.clip(elevation / (np.pi / 2), 0, 1)[..., None]
    dusk = np.array([0.34, 0.31, 0.29]) * (1 - 0.2 * height)
    return drawn(over(dusk, sky(height), soft_step(np.arcsin(direction[..., 1]))), inside)


def night(size: int) -> Image:
    """Stars on a sky next to black, with a glow on the horizon: (N, N, 3) linear."""
    direction, inside = master_directions(size)
    _, elevation = angles_from_direction(direction)
    rng = np.random.default_rng(1)
    stars = normalise(rng.normal(0, 1, (2 * STARS, 3)))
    magnitude = rng.uniform(0.1, 1, len(stars)) ** 2
    away, which = cKDTree(stars).query(direction, distance_upper_bound=5 * STAR_SIGMA)
    star = np.append(magnitude, 0)[which] * np.exp(-0.5 * (away / STAR_SIGMA) ** 2)
    glow = (1 - np.clip(elevation / (np.pi / 2), 0, 1)) ** 4
    dark = np.array([0.018, 0.020, 0.028]) * (1 + 2 * glow[..., None])
    light = dark + star[..., None] * np.array([0.90, 0.92, 0.97])
    return drawn(np.minimum(light, 1), inside)


def checker(size: int) -> Image:
    """Squares of three degrees, light and dark, with hard edges: (N, N, 3) linear."""
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    from_pole = np.pi / 2 - elevation
    across = [np.floor(from_pole * turn(azimuth) / SQUARE) for turn in (np.cos, np.sin)]
    light = (sum(across) % 2 == 0)[..., None]
    return drawn(np.where(light, [0.70, 0.72, 0.75], [0.34, 0.32, 0.30]), inside)


def texture(size: int) -> Image:
    """Grey noise whose amplitude falls with its spatial frequency, as in photographs: (N, N, 3) linear."""
    _, inside = master_directions(size)
    rng = np.random.default_rng(5)
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    spectrum = np.fft.rfft2(rng.normal(size=(size, size))) / np.maximum(frequency, 1 / size)
    noise = np.fft.irfft2(spectrum, s=(size, size))
    level = np.clip(0.4 + 0.15 * (noise - noise.mean()) / noise.std(), 0.02, 0.9)
    return drawn(np.repeat(level[..., None], 3, axis=-1), inside)


CONTENTS: Mapping[str, Callable[[int], Image]] = {
    "half-sky": half_sky,
    "left-right": left_right,
    "night": night,
    "interior": interior,
    "checker": checker,
    "texture": texture,
    "white": white,
}
