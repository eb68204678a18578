"""Explanations of a changed response: another exponent, or other ends of the signal range.

An input that takes pictures of full range for limited ones shows all drives up to 16/255 as black, and all
from 235/255 on as white. That leaves the exponent as it was, so that the ends are fitted as well as the
exponent, and the explanation with fewest freedoms is taken. What none explains is given as the largest
departure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array
from procam.model.photometry import CERTAIN, Departure, departures

GAMMA = 2.2  # of the domain of interpolation
LEAST_LEVELS = 6  # for the ends of the range to be fitted
EXPONENT, ENDS = (0,), (1, 2)  # freedoms of an explanation
UNCHANGED = np.array([0.0, 0.0, 1.0])  # log of the exponent's factor, black's and white's drive
START = np.array([0.0, 0.03, 0.95])  # inside of the limits, where the light depends on both ends
# a range that became narrower shows as a raised black and a darker white, and hardly as another response
LIMITS = np.array([[-3.0, 0.0, 0.6], [3.0, 0.4, 1.0]])
FINE = 256  # drives at which the effect of the ends is read


NO_DEPARTURE = Departure(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Explanation:
    """An explanation of a change.

    Attributes
    ----------
    exponent, exponent_sigma : factor on the exponent.
    ends, ends_sigma : (2,) drives [-] that are shown as black and as white; 0 and 1 as they were.
    misfit : sum of squares over variances, of which large ones count less. freedoms : which are fitted.
    """

    exponent: float
    exponent_sigma: float
    ends: Array
    ends_sigma: Array
    misfit: float
    freedoms: tuple[int, ...]


class LevelModel:
    """The response at some levels before and now.

    Parameters
    ----------
    drives : (L,) of the levels. old, new : (L, C) responses from 0 to 1; `sigma` (L, C) of their difference.
    raised : drive that black has become: drives d are shown as raised + (1 - raised) d.
    """

    def __init__(
        self, drives: Array, old: Array, new: Array, sigma: Array, raised: float = 0.0
    ) -> None:
        self._drives, self._old, self._new, self._sigma = drives, old, new, sigma
        self._raised = raised

    def fit(self, freedoms: Sequence[int] = EXPONENT) -> Explanation:
        """The best explanation with some freedoms; the others are as they were."""
        free = list(freedoms)

        def off(x: Array) -> Array:
            full = UNCHANGED.copy()
            full[free] = x
            return np.asarray(((self._altered(full) - self._new) / self._sigma)[1:-1].ravel())

        found = least_squares(
            off,
            START[free],
            loss="soft_l1",
            x_scale=0.01,
            bounds=(LIMITS[0, free], LIMITS[1, free]),
        )
        x, sigma = UNCHANGED.copy(), np.zeros(3)
        slopes, spare = np.asarray(found.jac), max(1, found.fun.size - len(free))
        inverse = np.linalg.pinv(slopes.T @ slopes) * max(1.0, 2 * found.cost / spare)
        x[free], sigma[free] = found.x, np.sqrt(np.diag(inverse))
        factor = float(np.exp(x[0]))
        misfit = 2 * float(found.cost)
        return Explanation(factor, factor * sigma[0], x[1:], sigma[1:], misfit, tuple(free))

    def explain(self) -> Explanation:
        """The best explanation, where a further freedom must remove `CERTAIN` sigmas of misfit."""
        if len(self._drives) < LEAST_LEVELS:
            return self.fit()
        fits = [self.fit(freedoms) for freedoms in (EXPONENT, ENDS, EXPONENT + ENDS)]
        noise = max(1.0, fits[-1].misfit / self._new[1:-1].size)
        return min(fits, key=lambda f: f.misfit / noise + CERTAIN**2 * len(f.freedoms))

    def of(self, column: int) -> "LevelModel":
        """The same of one channel."""
        at = slice(column, column + 1)
        return LevelModel(
            self._drives, self._old[:, at], self._new[:, at], self._sigma[:, at], self._raised
        )

    def effect_of_ends(self, found: Explanation) -> Departure:
        """The largest change of light by the ends."""
        moved = np.hypot(found.ends[0], found.ends[1] - 1)
        if moved == 0:
            return NO_DEPARTURE
        fine = np.linspace(0, 1, FINE)
        light = [self._altered(np.array([0.0, *e]), fine) for e in (found.ends, UNCHANGED[1:])]
        step = (light[0] - light[1]).mean(axis=1)
        at = int(np.argmax(np.abs(step)))
        sigma = abs(step[at]) * float(np.hypot(*found.ends_sigma)) / moved
        return Departure(float(step[at]), float(sigma), float(fine[at]))

    def rest(self, found: Explanation) -> Departure:
        """The largest difference that is not explained, of one channel or of their mean."""
        step = self._new - self._altered(np.array([np.log(found.exponent), *found.ends]))
        return max(
            departures(step, self._sigma, self._drives), key=lambda departure: departure.excess
        )

    def _altered(self, x: Array, drives: Array | None = None) -> Array:
        """The response (L, C) of before, altered by the log of an exponent and by ends."""
        change, low, high = x
        shown = ((self._drives if drives is None else drives) - low) / (high - low)
        drive = np.clip(self._raised + (1 - self._raised) * shown, 0, 1)
        light = np.stack([self._between(drive, c) for c in self._old.T], axis=1)
        light = _power(light, np.exp(change))
        return np.asarray((light - light[0]) / (light[-1] - light[0]))

    def _between(self, drive: Array, column: Array) -> Array:
        """A response (L,) at other drives (n,), interpolated where it is nearly linear."""
        roots = np.interp(drive, self._drives, _power(column, 1 / GAMMA))
        return _power(np.asarray(roots), GAMMA)


def _power(light: Array, exponent: float) -> Array:
    """A power of light, which is below 0 where the darkest tile gets more scattered light than its own."""
    return np.asarray(np.sign(light) * np.abs(light) ** exponent)
