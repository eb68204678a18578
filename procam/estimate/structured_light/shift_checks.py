"""Checks that sinusoids agree with each other and with the stripes beneath; with wrong shifts they do not.

The phases of several periods then lie apart. Shifts that are all wrong by one angle move every column
alike and leave no residual among the sinusoids, but the edges of Gray cells do not move with them.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from procam.arrays import AnyArray, Array, Map
from procam.estimate.structured_light.cells import Cells
from procam.maths.codes.phase import Waves

MOST_PIXELS = 20_000  # evenly picked
BINS = 8  # of columns, of which each has a mean phase: a wrong period is off by more in the next
LEAST_PIXELS = 50  # of a bin
APART_DEG = 7.5  # scattered light, gamma and exposures that jump move the widest fringes by up to 5
EQUAL = 1e-6  # sum of the unit vectors of equal steps, per step
EDGE_PIXELS = 3000  # evenly picked, for the edges of cells
STEP_PX = 0.1
APART_PX = 0.5  # sinusoids drawn without regard to gamma, through cameras that encode, give 0.2


def phases_note(frames: Sequence[AnyArray], waves: Waves, x: Map, length: int) -> str:
    """What is wrong if the phases of a period do not agree with columns `x` (H, W); empty if they do."""
    apart = {
        period: np.abs(off).max() for period, off in phases_apart_deg(frames, waves, x, length)
    }
    if not apart or max(apart.values()) <= APART_DEG:
        return ""
    period = max(apart, key=lambda p: apart[p])
    return (
        f"the sinusoids of period {period:g} px lie up to {apart[period]:.0f} degrees from where the decoded "
        "columns put them, so that these may be wrong by more than they state; check periods and shifts"
    )


def phases_apart_deg(
    frames: Sequence[AnyArray], waves: Waves, x: Map, length: int
) -> Iterator[tuple[float, Array]]:
    """Each period of three equal steps or more, and how far its phase is off, per bin of columns."""
    known = np.flatnonzero(np.isfinite(x))
    known = known[:: max(1, known.size // MOST_PIXELS)]
    column = np.ravel(x)[known].astype(float)
    each = np.clip(column / length * BINS, 0, BINS - 1).astype(int)
    enough = np.bincount(each, minlength=BINS) >= LEAST_PIXELS
    for period in np.unique(waves.periods):
        steps = np.flatnonzero(waves.periods == period).tolist()
        turns = np.exp(1j * waves.shifts[steps])
        if len(steps) < 3 or abs(turns.sum()) > EQUAL * len(steps) or not enough.any():
            continue
        seen = np.sum(
            [t * np.ravel(frames[i])[known] for i, t in zip(steps, turns, strict=True)], axis=0
        )
        off = seen * np.exp(-2j * np.pi * column / period)
        sums = [np.bincount(each, part, BINS) for part in (off.real, off.imag)]
        yield float(period), np.degrees(np.arctan2(sums[1], sums[0]))[enough]


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
    known = known[:: max(1, known.size // EDGE_PIXELS)]
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
