"""Bands that are in today's photographs, and not in those of the calibration.

A rolling shutter that reads pulsing light makes rows bright and dark in turn. Each projector counts less
what changes of its lamp and its lens do: a level, a slope and a hot spot. A stripe of dirt is no wave.
"""

from collections.abc import Iterable

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray
from procam.estimate.drift.pictures import VenuePhotographs
from procam.estimate.light.bands import Bands, find_bands

LEAST_LIGHT = 0.1  # of a projector's bright white: below it ratios are noise
LEAST_SHARE = 0.7  # of the variance of rows or columns
FEWEST_PIXELS = 100
MOST_CHANGE = 0.5  # logarithm: people and edges
GREEN = 1


def find_banding(
    before: VenuePhotographs, now: VenuePhotographs, still: Iterable[str]
) -> Bands | None:
    """Bands in the light of whites over that before, of projectors and a camera that stood still."""
    departure, weight = (np.zeros(before.view.on_screen.shape) for _ in range(2))
    for name in still:
        old, new = (p.projectors[name].white[..., GREEN] for p in (before, now))
        lit = _lit(before.view.on_screen, old, new)
        if lit.sum() >= FEWEST_PIXELS:
            departure[lit] += old[lit] * _without_trend(np.log(new[lit] / old[lit]), lit)
            weight[lit] += old[lit]
    use = weight > 0
    if not use.any():
        return None
    found = find_bands(np.divide(departure, weight, out=departure, where=use), use)
    return found if found and found.share > LEAST_SHARE else None


def _lit(on_screen: BoolArray, old: AnyArray, new: AnyArray) -> BoolArray:
    """Where a white (H, W) is bright before, and seen now."""
    with np.errstate(invalid="ignore"):
        lit = on_screen & (old > 0) & (new > 0)
        if lit.any():
            lit &= old > LEAST_LIGHT * np.percentile(old[lit], 95)
    return np.asarray(lit)


def _without_trend(change: Array, lit: BoolArray) -> Array:
    """Changes (n,) of pixels less a quadratic surface, fitted without people and edges."""
    y, x = (2 * place / max(lit.shape) - 1 for place in np.nonzero(lit))
    surface = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    change = change - np.median(change)
    like = np.abs(change) < MOST_CHANGE
    trend = np.linalg.lstsq(surface[like], change[like], rcond=None)[0]
    return np.asarray(change - surface @ trend)
