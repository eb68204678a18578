"""Local variation of a media server's response, as its projectors differ."""

from collections.abc import Iterable, Iterator

import numpy as np

from procam.arrays import Array, Image, IndexArray
from procam.estimate.structured_light.patterns import LEVELS
from procam.maths.light.curves import apply_curve
from procam.maths.warp import blur, sample
from procam.model.photometry import ResponseCurve

Levels = tuple[Image, IndexArray]
Sample = tuple[Array, Array, Array]
CELLS = 40  # along each side of a master, about one per tile of the level pictures
SMOOTH = 1.5  # cells over which evidence is averaged: a few dozen tiles, so that all levels occur
ROUNDS = 2
PRIOR_WEIGHT = 0.02  # of exponent 1, relative to the cell with the most evidence
DARKEST = 1e-4  # of a response, whose logarithm is taken


def level_samples(
    pictures: Iterable[Levels], white: Image, mix: Array, places: Image, size: int
) -> Iterator[Sample]:
    """Samples of level pictures: light (K, 3) of the primaries, drive (K, 3), position (K, 2) in 0..1.

    Parameters
    ----------
    pictures : direct light (H, W, 3) and index into LEVELS (H, W), -1 for none, of each.
    white : (H, W, 3) direct light of white. mix : (3, 3) of `ColourFit`.
    places : (H, W, 2) position that each camera pixel sees in a master of `size` pixels [px].
    """
    unmix = np.linalg.inv(mix).T
    for light, level in pictures:
        use = (level >= 0) & np.isfinite(light).all(axis=-1) & (white.min(axis=-1) > 0)
        drive = np.array(LEVELS)[level[use]] / 255
        relative = (light[use] / white[use]).astype(float) @ unmix
        yield relative, np.repeat(drive[:, None], 3, axis=1), (places[use] + 0.5) / size


def fit_exponent(samples: Iterable[Sample], response: ResponseCurve, size: int) -> Image:
    """Exponents p (N, N, 3) with light = response(drive) ** p, over a master of `size` pixels.

    Gauss-Newton per cell with evidence smoothed over neighbours. One exponent per position and
    primary suffices: other gammas and S-shaped curves both differ most at a third of white.
    """
    known = [
        (light, np.clip(apply_curve(drive, response.levels, response.values), DARKEST, 1), at)
        for light, drive, at in samples
    ]
    grid = np.ones((CELLS, CELLS, 3))
    for _ in range(ROUNDS):
        top, bottom = np.zeros((2, CELLS**2, 3))
        for light, whole, at in known:
            column, row = np.clip(at.T * CELLS, 0, CELLS - 1).astype(np.intp)
            expected = whole ** grid[row, column]
            slope = expected * np.log(whole)
            for c in range(3):
                evidence = slope[:, c] * (light[:, c] - expected[:, c])
                top[:, c] += np.bincount(row * CELLS + column, evidence, CELLS**2)
                bottom[:, c] += np.bincount(row * CELLS + column, slope[:, c] ** 2, CELLS**2)
        step, weight = (blur(a.reshape(CELLS, CELLS, 3), SMOOTH) for a in (top, bottom))
        grid = grid + step / (weight + PRIOR_WEIGHT * weight.max(axis=(0, 1)))
    line = (np.arange(size) + 0.5) / size * CELLS - 0.5
    where = np.clip(np.stack(np.meshgrid(line, line), axis=-1), 0, CELLS - 1)
    return sample(grid, where)
