"""What the perceptual methods may not do: lose more luminance than allowed, or change hues that are seen."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procam.arrays import Array, Array32, IndexArray
from procam.compensate.perceptual.descent import Problem
from procam.compensate.perceptual.light import Stage
from procam.compensate.perceptual.objective import luma
from procam.compensate.perceptual.settings import Perceptual
from procam.maths.vision.hue import hue_difference
from procam.maths.vision.pu21 import pu21_table

BISECTIONS, FEW_BISECTIONS = 10, 5  # of pictures, of samples of frames
CERTAIN = 2.0  # standard errors by which a bound must hold on a sample
ROUNDS = 8  # of the scattered light, each half the way
HUE_SHIFT = 2.0  # dE2000, median where the exact solution is at a limit
NEGLIGIBLE = 1e-2  # error of an exact solution [PU21 units squared]: a tenth of what can be seen
DIFFERENT = 1e-6  # light [rel]: there it is
MOST_PLACES = 2**14  # for the median


def mixed(first: Array32, last: Array32, share: float) -> Array32:
    """Light on the way between two pictures."""
    return first + np.float32(share) * (last - first)


def decibels(ratio: float) -> float:
    """Of a ratio of squared errors."""
    return float(10 * np.log10(ratio))


def clipped_places(exact: Array32, target: Array32, weight: Array32) -> IndexArray:
    """Where, in flat planes, the exact solution's light (3, H, W) misses its target; a sample of many."""
    missed = (np.abs(exact - target) > DIFFERENT).any(axis=0) & (weight > 0)
    places = np.flatnonzero(missed)
    return places[:: max(1, len(places) // MOST_PLACES)]


def hue_is_kept(first: Array32, last: Array32, places: IndexArray) -> bool:
    """Whether hues (3, H, W) differ by at most what may be, at places of flat planes."""
    if not len(places):
        return True
    pair = [light.reshape(len(light), -1)[:, places] for light in (first, last)]
    return float(np.median(hue_difference(*pair))) <= HUE_SHIFT


def largest(holds: Callable[[float], bool], halvings: int) -> float:
    """The largest share for which something holds that holds for 0, by halving."""
    if holds(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(halvings):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def hue_limited(problem: Problem, exact: Array32, found: Array32) -> Array32:
    """Direct light `found` (3, H, W), its colours so near those of total light `exact` that hues are kept.

    Luminance stays, as far as the limits on each colour let it.
    """
    total = problem.transport.total(found)
    places = clipped_places(exact, problem.guard.target, problem.guard.weight)
    scattered, bright = total - found, np.maximum(luma(total), np.float32(DIFFERENT))
    first = (exact * (bright / np.maximum(luma(exact), DIFFERENT))).astype(np.float32)

    def limited(share: float) -> Array32:
        return np.clip(mixed(first, total, share) - scattered, problem.lo, problem.hi)

    def holds(share: float) -> bool:
        return hue_is_kept(exact, problem.transport.total(limited(share)), places)

    share = largest(holds, FEW_BISECTIONS)
    return found if share == 1 else limited(share)


@dataclass(frozen=True, eq=False)
class Way:
    """From the exact solution's total light, `first`, to the optimum's, `last`: (3, H, W) each.

    `allowed` is the factor by which squared errors of luminance may grow.
    """

    problem: Problem
    first: Array32
    last: Array32
    allowed: float

    def length(self) -> float:
        """The share of it that luminance and hue allow; 0 if contrast is no nearer to the target's there."""
        low = largest(self._holds, BISECTIONS)
        contrast = self.problem.contrast
        better = contrast.of(mixed(self.first, self.last, low))[0] < contrast.of(self.first)[0]
        return low if better else 0.0

    def loss_db(self, share: float) -> float:
        """What a share costs in luminance [dB]."""
        return decibels(self._error(share) / self._error(0.0))

    def _holds(self, share: float) -> bool:
        if self._error(share) > self._error(0.0) * self.allowed:
            return False
        return hue_is_kept(self.first, mixed(self.first, self.last, share), self._clipped)

    def _error(self, share: float) -> float:
        return self.problem.guard.luminance(mixed(*self._lumas, share))

    @cached_property
    def _lumas(self) -> tuple[Array32, Array32]:
        return luma(self.first), luma(self.last)

    @cached_property
    def _clipped(self) -> IndexArray:
        guard = self.problem.guard
        return clipped_places(self.first, guard.target, guard.weight)


@dataclass(frozen=True, eq=False)
class SampledWay:
    """The same for a sample of a frame, whose exact solution depends on the target asked for.

    `picture` and `changed` (3, h, w) are targets at the ends, `moments` (3, T) of their direct light, about.
    """

    stage: Stage
    picture: Array32
    changed: Array32
    moments: tuple[Array, Array]
    settings: Perceptual
    is_whole: bool

    def length(self) -> float:
        """The share that luminance and hue allow; of a sample that is not the whole picture, surely."""
        return largest(self._holds, FEW_BISECTIONS) if self._error(0.0) > NEGLIGIBLE else 0.0

    def _holds(self, share: float) -> bool:
        above = self._errors(share) - self._errors(0.0) * self.settings.allowed
        weight = self.stage.weight
        mean = float(np.vdot(weight, above))
        sigma = 0.0 if self.is_whole else float(np.linalg.norm(weight * (above - mean)))
        if mean + CERTAIN * sigma > 0:
            return False
        places = clipped_places(self._seen(0.0), self.picture, weight)
        return hue_is_kept(self._seen(0.0), self._seen(share), places)

    def _error(self, share: float) -> float:
        return float(np.vdot(self.stage.weight, self._errors(share)))

    def loss_db(self, share: float) -> float:
        """What a share costs in luminance [dB]."""
        return decibels(self._error(share) / self._error(0.0))

    def _errors(self, share: float) -> Array32:
        """(h, w) [PU21 units squared]."""
        white = np.float32(self.settings.white_nits)
        lights = self._seen(share), self.picture
        units = [pu21_table()(luma(light) * white)[0] for light in lights]
        return (units[0] - units[1]) ** 2

    def _seen(self, share: float) -> Array32:
        """Total light (3, h, w) of the exact solution."""
        if share not in self._known:
            asked = mixed(self.picture, self.changed, share)
            moments = self.moments[0] + share * (self.moments[1] - self.moments[0])
            for _ in range(ROUNDS):
                direct = self.stage.limited(asked - self.stage.transport.scattered(moments))
                moments = (moments + self.stage.transport.moments(direct)) / 2
            self._known[share] = self.stage.transport.total(direct)
        return self._known[share]

    @cached_property
    def _known(self) -> dict[float, Array32]:
        return {}
