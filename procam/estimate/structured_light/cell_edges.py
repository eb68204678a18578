"""Checks that the edges of Gray cells lie where the sinusoids put them; with wrong shifts they do not.

Shifts that are all wrong by one angle move every column alike and leave no residual among the sinusoids.
The stripes beneath do not move with them.
"""

import numpy as np

from procam.arrays import Array, Map
from procam.estimate.structured_light.cells import Cells

MOST_PIXELS = 3000  # evenly picked
STEP_PX = 0.1
APART_PX = 0.5  # sinusoids drawn without regard to gamma, through cameras that encode, give 0.2


def edges_refusal(cells: Cells, x: Map, period: float) -> str:
    """What is wrong if the edges are apart, and what to do; empty if they are not."""
    apart = edges_apart_px(cells, x, period)
    if abs(apart) <= APART_PX:
        return ""
    return (
        f"the edges of the Gray cells lie {abs(apart):.1f} px from where the sinusoids say; check shifts "
        "and periods, and where a cell starts"
    )


def edges_apart_px(cells: Cells, x: Map, period: float) -> float:
    """By how much columns `x` (H, W) must be moved for the stripes to fit best, within half a period [px].

    Near an edge a wrong shift also chooses the wrong period, so that the next ones are tried too.
    """
    known = np.flatnonzero(np.isfinite(x))
    known = known[:: max(1, known.size // MOST_PIXELS)]
    if not known.size:
        return 0.0
    shown, columns = cells.at(known), np.ravel(x)[known].astype(float)
    most = np.maximum(np.max(np.abs(shown.contrast), axis=0), 1e-9)
    values = np.stack(shown.contrast) / most
    moves = STEP_PX * np.arange(np.ceil(-period / 2 / STEP_PX), period / 2 / STEP_PX)
    misfit = [_misfit(values, shown.lines, columns + move, period) for move in moves]
    return float(moves[int(np.argmin(misfit))])


def _misfit(values: Array, lines: Array, columns: Array, period: float) -> float:
    """Sum of squares that the stripes (B, n) leave at columns (n,), or a period before or after."""
    grid = np.arange(lines.shape[1])
    squares = [
        sum(
            (value - np.interp(columns + turn * period, grid, line)) ** 2
            for value, line in zip(values, lines, strict=True)
        )
        for turn in (-1, 0, 1)
    ]
    return float(np.sum(np.min(squares, axis=0)))
