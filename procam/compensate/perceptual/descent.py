"""The light that costs the eye least.

log J + multiplier P / most is made small, J of `Contrast` and P of `Guard`, by Adam (Kingma and Ba 2015,
arXiv:1412.6980) in the logarithm of the total light, with the limits kept exactly. The multiplier grows while
P is above `most` and falls while it is below. Equations: docs/theory/perceptual.md.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from procam.arrays import Array32
from procam.compensate.perceptual.objective import Contrast, Guard

LAST_RATE = 0.1  # of the first
MEMORY = (0.9, 0.99)
PULL, LARGEST_PULL = 0.3, 5.0  # of the logarithm of the multiplier, per step
EXTREMES = 1e-3, 1e3  # of the multiplier: a long movie must not lose itself
LEAST_LIGHT = np.float32(1e-6)  # offset of the logarithm where no light is scattered [rel]
NOTHING = np.float32(1e-20)
LEAST = 1e-9  # of J and P: there is nothing left to gain


class Transport(Protocol):
    """How direct light becomes total light."""

    def total(self, direct: Array32) -> Array32:
        """Total light of direct light."""

    def adjoint(self, slope: Array32) -> Array32:
        """Slopes over direct light, from those over total light."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A picture to show, in planes: its costs, what carries its light, and the limits (3, H, W)."""

    contrast: Contrast
    guard: Guard
    transport: Transport
    lo: Array32
    hi: Array32


@dataclass(eq=False)
class Multiplier:
    """Of the guard, relative to that of J; it is kept from frame to frame."""

    value: float = 1.0

    def pull(self, error: float, most: float) -> None:
        """Change it by how far an error is from the most that is allowed."""
        above = np.log(max(error, LEAST) / most)
        pulled = self.value * np.exp(PULL * np.clip(above, -LARGEST_PULL, LARGEST_PULL))
        self.value = float(np.clip(pulled, *EXTREMES))


@dataclass(eq=False)
class Descent:
    """Steps downhill; `scattered` (3, H, W) is what about will be scattered, and keeps logarithms finite."""

    problem: Problem
    scattered: Array32
    multiplier: Multiplier = field(default_factory=Multiplier)

    def run(self, start: Array32, most: float, steps: int, rate: float) -> Array32:
        """Direct light (3, H, W) after some steps, P of at most `most`."""
        problem, offset = self.problem, np.maximum(self.scattered, LEAST_LIGHT)
        low, high = (np.log(limit + offset) for limit in (problem.lo, problem.hi))
        place = np.clip(np.log(start + offset), low, high)
        mean, square = np.zeros_like(place), np.zeros_like(place)
        direct = start
        for number in range(steps):
            slope = self._slope(direct, most)
            slope *= direct + offset
            slope[((place <= low) & (slope > 0)) | ((place >= high) & (slope < 0))] = 0
            mean += np.float32(1 - MEMORY[0]) * (slope - mean)
            square += np.float32(1 - MEMORY[1]) * (slope * slope - square)
            known = [1 - m ** (number + 1) for m in MEMORY]
            size = np.sqrt(square / np.float32(known[1])) + NOTHING
            now = rate * (1 - (1 - LAST_RATE) * number / steps) / known[0]
            place = np.clip(place - np.float32(now) * mean / size, low, high)
            direct = np.clip(np.exp(place) - offset, problem.lo, problem.hi)
        return direct

    def _slope(self, direct: Array32, most: float) -> Array32:
        """Slope of log J + multiplier P / most over direct light."""
        total = self.problem.transport.total(direct)
        j, sharp = self.problem.contrast.of(total)
        p, guarded = self.problem.guard.of(total)
        slope = sharp / np.float32(max(j, LEAST)) + guarded * np.float32(
            self.multiplier.value / most
        )
        self.multiplier.pull(p, most)
        return self.problem.transport.adjoint(slope)
