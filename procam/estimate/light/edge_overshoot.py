"""Measures whether light is brighter beside the edges of stripes, as sharpening makes it."""

import numpy as np

from procam.arrays import BoolArray, FloatArray

# where an edge overshoots that something sharpens, and where it no longer does [camera px]
NEAR_PX, BEYOND_PX = (1.8, 3.2), 6.0
MANY_PIXELS = 200  # beside edges, of which their mean is taken


class EdgeOvershoot:
    """Compares the same pixels in two pairs of stripes, of which one has an edge beside them.

    Light differs from place to place, so other pixels would be no comparison. Blur makes pixels darker
    beside an edge. `largest` is the largest relative difference so far.
    """

    def __init__(self) -> None:
        self.largest = -np.inf
        self._before: tuple[FloatArray, BoolArray, BoolArray] | None = None

    def add(self, direct: FloatArray, away_px: FloatArray, inside: BoolArray) -> None:
        """Add a pair: direct light of white (H, W) by it, and distance of its edges [camera px]."""
        use = inside & np.isfinite(direct)
        near = use & (away_px >= NEAR_PX[0]) & (away_px < NEAR_PX[1])
        now, before = (direct, near, use & (away_px >= BEYOND_PX)), self._before
        self._before = now
        if before is not None:
            self._compare(now, before)
            self._compare(before, now)

    def _compare(
        self,
        edged: tuple[FloatArray, BoolArray, BoolArray],
        other: tuple[FloatArray, BoolArray, BoolArray],
    ) -> None:
        (beside, edges, _), (inside, _, none) = edged, other
        same = edges & none
        if same.sum() >= MANY_PIXELS:
            found = float(beside[same].sum() / inside[same].sum() - 1)
            self.largest = max(self.largest, found)
