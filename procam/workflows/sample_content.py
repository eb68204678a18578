"""Content to try a dome with: light that is anywhere but where it is wanted dark."""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial import cKDTree

from procam.arrays import Array, BoolArray, Image
from procam.maths.geometry.sphere import angles_from_direction, master_directions, normalise

HORIZON = np.radians(30.0)
TREE_SPACING = np.radians(45.0)
SQUARE = np.radians(3.0)
STARS = 500
STAR_SIGMA = np.radians(0.3)
CEILING = np.radians(42.0)
WINDOW_SPACING = np.radians(50.0)


def half_sky(size: int) -> Image:
    """A bright sky over a darker ground, split by elevation, with black trees: (N, N, 3) linear.

    The sky's light falls on the ground by way of the dome; the trees ask for less light than
    that, which no projector can give.
    """
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    height = np.clip((elevation - HORIZON) / (np.pi / 2 - HORIZON), 0, 1)[..., None]
    furrow = 0.5 + 0.5 * np.cos(24 * azimuth) * np.cos(elevation / HORIZON * np.pi)
    ground = np.array([0.30, 0.27, 0.20]) * (0.85 + 0.5 * furrow)[..., None]
    from_trunk = np.abs((azimuth / TREE_SPACING) % 1 - 0.5) * TREE_SPACING * np.cos(elevation)
    tree = _soft_step(np.radians(4) - from_trunk) * _soft_step(0.8 * HORIZON - elevation)
    ground = _over(ground, np.array(0.02), tree)
    return _drawn(_over(ground, _sky(height), _soft_step(elevation - HORIZON)), inside)


def left_right(size: int) -> Image:
    """Day on the left half of the dome, dusk on the right: (N, N, 3) linear.

    The most one-sided of pictures: one scalar for all scattered light misses what a floor returns.
    """
    direction, inside = master_directions(size)
    _, elevation = angles_from_direction(direction)
    height = np.clip(elevation / (np.pi / 2), 0, 1)[..., None]
    dusk = np.array([0.34, 0.31, 0.29]) * (1 - 0.2 * height)
    return _drawn(_over(dusk, _sky(height), _soft_step(np.arcsin(direction[..., 1]))), inside)


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
    sky = np.array([0.018, 0.020, 0.028]) * (1 + 2 * glow[..., None])
    light = sky + star[..., None] * np.array([0.90, 0.92, 0.97])
    return _drawn(np.minimum(light, 1), inside)


def interior(size: int) -> Image:
    """A room: windows in the front, pale walls and ceiling, dark furniture: (N, N, 3) linear."""
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    to_front = (0.5 + 0.5 * direction[..., 0])[..., None]
    wall = np.array([0.36, 0.33, 0.29]) * (1.15 - 0.3 * to_front)
    ceiling = np.array([0.46, 0.45, 0.42]) * (0.8 + 0.4 * to_front)
    across = ((azimuth / WINDOW_SPACING + 0.5) % 1 - 0.5) * WINDOW_SPACING
    reach = np.abs(across) * np.cos(elevation)
    band = _soft_step(elevation - np.radians(10)) * _soft_step(np.radians(36) - elevation)
    window = band * _soft_step(np.radians(15) - reach) * (np.abs(azimuth) < 1.5 * WINDOW_SPACING)
    chest = _soft_step(np.radians(8) - elevation) * _soft_step(np.radians(17) - reach)
    room = _over(wall, np.array([0.05, 0.04, 0.03]), chest)
    room = _over(room, np.array([0.88, 0.93, 1.0]), window)
    return _drawn(_over(room, ceiling, _soft_step(elevation - CEILING)), inside)


def checker(size: int) -> Image:
    """Squares of three degrees, light and dark, with hard edges: (N, N, 3) linear."""
    direction, inside = master_directions(size)
    azimuth, elevation = angles_from_direction(direction)
    from_pole = np.pi / 2 - elevation
    across = [np.floor(from_pole * turn(azimuth) / SQUARE) for turn in (np.cos, np.sin)]
    light = (sum(across) % 2 == 0)[..., None]
    return _drawn(np.where(light, [0.70, 0.72, 0.75], [0.34, 0.32, 0.30]), inside)


def texture(size: int) -> Image:
    """Grey noise whose amplitude falls with its spatial frequency, as in photographs: (N, N, 3) linear."""
    _, inside = master_directions(size)
    rng = np.random.default_rng(5)
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    spectrum = np.fft.rfft2(rng.normal(size=(size, size))) / np.maximum(frequency, 1 / size)
    noise = np.fft.irfft2(spectrum, s=(size, size))
    level = np.clip(0.4 + 0.15 * (noise - noise.mean()) / noise.std(), 0.02, 0.9)
    return _drawn(np.repeat(level[..., None], 3, axis=-1), inside)


def white(size: int) -> Image:
    """Full white: (N, N, 3) linear."""
    _, inside = master_directions(size)
    return _drawn(np.ones((size, size, 3)), inside)


CONTENTS: Mapping[str, Callable[[int], Image]] = {
    "half-sky": half_sky,
    "left-right": left_right,
    "night": night,
    "interior": interior,
    "checker": checker,
    "texture": texture,
    "white": white,
}


def _sky(height: Array) -> Array:
    """Day's sky (..., 3) from the horizon at 0 to the zenith at 1."""
    return (1 - height) * np.array([0.62, 0.72, 0.85]) + height * np.array([0.30, 0.45, 0.80])


def _over(under: Array, over: Array, share: Array) -> Array:
    return np.asarray(under + share[..., None] * (over - under))


def _drawn(picture: Array, inside: BoolArray) -> Image:
    return (picture * inside[..., None]).astype(np.float32)


def _soft_step(angle: Array) -> Array:
    """0 to 1 over two degrees: an edge that any projector can draw."""
    x = np.clip(angle / np.radians(2.0) + 0.5, 0, 1)
    return np.asarray(x * x * (3 - 2 * x))
