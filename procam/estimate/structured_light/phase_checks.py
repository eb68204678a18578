"""Checks that sinusoids of several periods agree; with wrong shifts or a wrong period they do not."""

from collections.abc import Iterator, Sequence

import numpy as np

from procam.arrays import AnyArray, Array, Map
from procam.maths.codes.phase import Waves

MOST_PIXELS = 20_000  # evenly picked
BINS = 8  # of columns, of which each has a mean phase: a wrong period is off by more in the next
LEAST_PIXELS = 50  # of a bin
APART_DEG = 7.5  # scattered light, gamma and exposures that jump move the widest fringes by up to 5
EQUAL = 1e-6  # sum of the unit vectors of equal steps, per step


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
