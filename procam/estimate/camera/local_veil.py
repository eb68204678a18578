"""The part of a lens's veil that stays near its light, from dark stripes (docs/theory/photometry.md)."""

import numpy as np

from procam.arrays import Array, BoolArray, Image
from procam.maths.warp import block_mean, blur_in_dark, enlarged, grow

# tried [of the picture's shorter side]; what fits the last one best is no veil of the lens: gloss, the floor
SPREADS = (0.03, 0.04, 0.055, 0.075, 0.1, 0.14)
CELL_PX = 4  # edge of the cells on which light is spread, and dark light compared
EDGE_PX = (
    4  # off the edge of what counts as dark: a trace of blurred light would look like a near veil
)
DARK_SHARE = 0.5  # of a cell
FEWEST = 1000  # dark cells of all pictures
MIN_SHARE = 0.05  # of the flux of white: with less there is nothing to scatter


def spread_light(light: Image, spread: float) -> Image:
    """Light (H, W[, C]) spread by a Gaussian of standard deviation `spread` [of the shorter side]."""
    return enlarged(_spread(block_mean(light, CELL_PX), spread), light.shape[:2])


def _spread(cells: Image, spread: float) -> Image:
    """Light of cells (h, w[, C]), spread; beyond the picture there is none."""
    return blur_in_dark(cells, spread * min(cells.shape[:2]))


class LocalVeilFit:
    """Finds how much of a lens's veil stays near its light, and how near.

    A place that is dark in several pictures sees scattered light in proportion to their flux. What
    differs, less that, is the veil of the bright stripes around it, which lie elsewhere in each picture.

    Parameters
    ----------
    seen : (H, W) pixels of the image circle.
    """

    def __init__(self, seen: BoolArray) -> None:
        self._seen = seen
        cells = block_mean(seen.astype(np.float32), CELL_PX).shape
        self._weight = np.zeros(cells, np.float32)
        self._dark = np.zeros(cells, np.float32)
        self._veil = np.zeros((len(SPREADS), *cells), np.float32)
        self._squares, self._products = np.zeros(len(SPREADS)), np.zeros(len(SPREADS))
        self._compared = 0

    def add(self, light: Image, dark: BoolArray, share: float) -> None:
        """Add a picture of one projector.

        Parameters
        ----------
        light : (H, W) less black, an even veil subtracted. dark : (H, W) sees scattered light alone.
        share : flux of the picture over that of white.
        """
        dark = grow(dark, -EDGE_PX)
        known = block_mean(dark.astype(np.float32), CELL_PX)
        use = known > DARK_SHARE
        level = block_mean(np.where(dark, light, 0), CELL_PX) / np.maximum(known, DARK_SHARE)
        shining = np.where(self._seen, np.nan_to_num(light), 0).astype(np.float32)
        mean, cells = np.float32(shining[self._seen].mean()), block_mean(shining, CELL_PX)
        # scattered light over the flux share has the weight of that share squared
        self._weight += use * np.float32(share**2)
        self._dark += use * np.float32(share) * level
        self._compared += int(use.sum()) if share > MIN_SHARE else 0
        for i, spread in enumerate(SPREADS):
            veil = use * (_spread(cells, spread) - mean)
            self._veil[i] += np.float32(share) * veil
            self._squares[i] += np.sum(veil**2, dtype=float)
            self._products[i] += np.sum(veil * level, dtype=float)

    def end_projector(self) -> None:
        """Forget what one projector scatters everywhere; what differs from it counts."""
        weight = np.maximum(self._weight, MIN_SHARE**2)
        for i, veil in enumerate(self._veil):
            self._squares[i] -= np.sum(veil**2 / weight, dtype=float)
            self._products[i] -= np.sum(veil * self._dark / weight, dtype=float)
        for sums in (self._weight, self._dark, self._veil):
            sums[...] = 0

    def result(self) -> tuple[float, float]:
        """Share of the light that stays near it, and its spread [of the shorter side]; 0 if none shows."""
        if self._compared < FEWEST:
            return 0.0, 0.0
        shares: Array = self._products / np.maximum(self._squares, 1e-30)
        best = int(np.argmax(self._products * np.maximum(shares, 0)))
        if shares[best] <= 0 or best == len(SPREADS) - 1:
            return 0.0, 0.0
        return float(shares[best]), SPREADS[best]
