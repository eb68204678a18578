"""Bands that are in today's photographs, and not in those of the calibration.

A rolling shutter that reads pulsing light makes rows bright and dark in turn. Lamps change the light of a
whole panel, so each projector counts less its own level; what moved shows at edges alone.
"""

import numpy as np

from procam.estimate.drift.pictures import VenuePhotographs
from procam.estimate.light.bands import Bands, find_bands

LEAST_LIGHT = 0.1  # of a projector's bright white: below it ratios are noise
GREEN = 1


def find_banding(before: VenuePhotographs, now: VenuePhotographs) -> Bands | None:
    """Bands in the light of all whites over that before; both by a camera that stood still."""
    departure, weight = (np.zeros(before.view.on_screen.shape) for _ in range(2))
    for name, was in before.projectors.items():
        old, new = (p.white[..., GREEN] for p in (was, now.projectors[name]))
        with np.errstate(invalid="ignore"):
            lit = before.view.on_screen & (old > 0) & (new > 0)
            lit &= old > LEAST_LIGHT * np.nanpercentile(np.where(lit, old, np.nan), 95)
        if lit.any():
            change = np.log(new[lit] / old[lit])
            departure[lit] += old[lit] * (change - np.median(change))
            weight[lit] += old[lit]
    use = weight > 0
    return find_bands(np.divide(departure, weight, out=departure, where=use), use)
