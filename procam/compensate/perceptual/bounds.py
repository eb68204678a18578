"""Bounds of the perceptual methods: how much luminance they may lose, and that they turn no visible hue."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procam.arrays import Array32, IndexArray
from procam.compensate.perceptual.descent import Problem
from procam.compensate.perceptual.objective import luma
from procam.compensate.perceptual.settings import Perceptual
from procam.maths.vision.hue import hue_difference
from procam.maths.vision.pu21 import pu21_table

HALVINGS = 8  # of the share of an optimum
HUE_HALVINGS = 5
HUE_SHIFT = 1.9  # dE2000, median where the exact solution is at a limit: 2, less what sampling adds
NEGLIGIBLE = 1e-2  # error of an exact solution [PU21 units squared]: a tenth of what can be seen
DARKEST = 1e-6  # light [rel]
MOST_PLACES = 2**14  # for the median
ROUNDING = 1e-3  # of the squared error: what tables and halvings add
CERTAIN = 2.0  # standard errors by which a bound must hold on a sample


def mixed(first: Array32, last: Array32, share: float) -> Array32:
    """Light between two pictures: a share of the last, the rest of the first."""
    return first + np.float32(share) * (last - first)


def largest(holds: Callable[[float], bool], halvings: int) -> float:
    """The largest share for which something holds that holds for 0, by halving."""
    if holds(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(halvings):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def limited_places(direct: Array32, lo: Array32, hi: Array32, weight: Array32) -> IndexArray:
    """Where, in flat planes, direct light (3, H, W) is at a limit in some colour; a sample of many."""
    at_limit = ((direct <= lo) | (direct >= hi)).any(axis=0) & (weight > 0)
    places = np.flatnonzero(at_limit)
    return places[:: max(1, len(places) // MOST_PLACES)]


def hue_is_kept(first: Array32, last: Array32, places: IndexArray) -> bool:
    """Whether hues (3, H, W) differ by at most what may be, at places of flat planes."""
    if not len(places):
        return True
    pair = [light.reshape(len(light), -1)[:, places] for light in (first, last)]
    return float(np.median(hue_difference(*pair))) <= HUE_SHIFT


def hue_limited(problem: Problem, exact: Array32, places: IndexArray, found: Array32) -> Array32:
    """Direct light `found` (3, H, W), its colours so near those of `exact`, total light, that hues are kept.

    Hues count at `places`. Luminance stays, as far as the limits of each colour allow.
    """
    transport = problem.transport
    total = transport.total(found)
    scattered, scale = total - found, luma(total) / np.maximum(luma(exact), DARKEST)
    same_hue = (exact * scale).astype(np.float32)

    def limited(share: float) -> Array32:
        return np.clip(mixed(same_hue, total, share) - scattered, problem.lo, problem.hi)

    def holds(share: float) -> bool:
        return hue_is_kept(exact, transport.total(limited(share)), places)

    share = largest(holds, HUE_HALVINGS)
    return found if share == 1 else limited(share)


@dataclass(frozen=True, eq=False)
class Allowance:
    """How much of an optimum the bounds allow.

    Attributes
    ----------
    seen : total light (3, H, W) by the share of the optimum; of 0 it is the exact solution's.
    target : (3, H, W). weight : (H, W), summing to 1. limited : places for hues, see `limited_places`.
    is_sample : of a picture's pixels, so that bounds must hold by some standard errors.
    """

    seen: Callable[[float], Array32]
    target: Array32
    weight: Array32
    limited: IndexArray
    settings: Perceptual
    is_sample: bool = False

    def share(self) -> float:
        """The largest share; 0 if there is nothing to gain."""
        return largest(self._holds, HALVINGS) if self._error(self._exact) > NEGLIGIBLE else 0.0

    def loss_db(self, share: float) -> float:
        """What a share costs in luminance [dB]."""
        return float(10 * np.log10(self._error(self._errors(share)) / self._error(self._exact)))

    def _holds(self, share: float) -> bool:
        above = self._errors(share) - self._exact * ((1 - ROUNDING) * self.settings.allowed)
        mean = self._error(above)
        if self.is_sample:
            mean += CERTAIN * float(np.linalg.norm(self.weight * (above - mean)))
        return mean <= 0 and hue_is_kept(self.seen(0.0), self.seen(share), self.limited)

    def _error(self, errors: Array32) -> float:
        return float(np.vdot(self.weight, errors))

    @cached_property
    def _exact(self) -> Array32:
        return self._errors(0.0)

    def _errors(self, share: float) -> Array32:
        """Squared errors of luminance (H, W) [PU21 units squared]."""
        return (self._units(self.seen(share)) - self._wanted) ** 2

    @cached_property
    def _wanted(self) -> Array32:
        return self._units(self.target)

    def _units(self, light: Array32) -> Array32:
        return pu21_table()(luma(light) * np.float32(self.settings.white_nits))[0]
