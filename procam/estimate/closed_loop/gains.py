"""Gains from the closed loop: how much of the light that is off is due to a wrong gain.

The gain of a cell shows as light received beyond what was asked, in proportion to it. What the
calibration misses in scattered light, veiling glare and black does not grow with the light asked for: in
a dark cell it would pass for a large error of the gain, and spoil a picture that is bright there. So gains
are learnt on a picture that is grey everywhere, and each cell's is the most probable one given how much
gains vary (docs/theory/closed-loop.md, L4).
"""

import numpy as np

from procam.arrays import Array, BoolArray
from procam.maths.statistics import robust_sigma

MIN_CELLS = 50  # of a channel; of fewer the variance of gains is unknown, and they stay as they are
OTHER_SIGMA = 1e-3  # of white: error of a cell's light that is no gain, as of veil and black
COMMON_SIGMA = 2e-3  # relative: by so much the level of all cells differs between pictures


def gain_change(surplus: Array, asked: Array, sigma: Array, known: BoolArray) -> Array:
    """Most probable relative change (n, C) of each cell's gain; 0 where not `known`.

    Parameters
    ----------
    surplus : (n, C) light received beyond what was asked [rel].
    asked : (n, C) direct light [rel].
    sigma : (n, C) standard error of the surplus by noise [rel].
    known : (n, C) cells that were measured.
    """
    change = np.zeros_like(surplus)
    for c in range(surplus.shape[1]):
        use = known[:, c] & (asked[:, c] > OTHER_SIGMA)
        if use.sum() >= MIN_CELLS:
            change[use, c] = _change(*(values[use, c] for values in (surplus, asked, sigma)))
    return change


def _change(surplus: Array, asked: Array, sigma: Array) -> Array:
    """(L4) of one channel (n,): the change common to all cells, and each cell's own."""
    common = float(asked @ surplus / (asked @ asked))
    common *= common**2 / (common**2 + COMMON_SIGMA**2)
    own = surplus / asked - common
    error = (sigma**2 + OTHER_SIGMA**2) / asked**2
    variance = max(robust_sigma(own) ** 2 - float(np.median(error)), 0.0)
    return common + variance / (variance + error) * own
