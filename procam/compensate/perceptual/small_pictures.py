"""Solutions of small pictures, each from that of the one before, as changes for large ones."""

from dataclasses import dataclass, field

import numpy as np

from procam.arrays import Array, Array32, Image
from procam.compensate.perceptual.bounds import NEGLIGIBLE, hue_limited
from procam.compensate.perceptual.descent import Descent, Multiplier
from procam.compensate.perceptual.guided import Change
from procam.compensate.perceptual.light import Stage, planes
from procam.compensate.perceptual.settings import Perceptual
from procam.maths.warp import reduced_to

REDUCTION = 4  # of a picture's edge
STEPS, RATE = 25, 0.12  # of the first picture
NEXT_STEPS, NEXT_RATE = 4, 0.05  # of those after it
SMOOTHING = 0.5  # share of a new picture in the change that is used
CUT = 0.5  # mean change of the logarithm of light from picture to picture that is a cut
DARK = np.float32(1e-3)  # light [rel] added before that logarithm


@dataclass(frozen=True, eq=False)
class Solved:
    """A small picture (3, h, w), how it is changed, and the moments (3, T) of its direct light.

    `is_first` : none came before it, or another scene.
    """

    target: Array32
    change: Change
    moments: Array
    is_first: bool


@dataclass(eq=False)
class SmallPictures:
    """Pictures reduced to the size of a stage; `multiplier` is the guard's after the last one."""

    stage: Stage
    settings: Perceptual
    multiplier: Multiplier = field(default_factory=Multiplier)
    _last: Solved | None = None

    def solve(self, picture: Image, exact_moments: Array) -> Solved:
        """Solve a picture (N, N, 3) whose exact solution has moments (3, T)."""
        target = planes(reduced_to(picture, self.stage.weight.shape)) * (self.stage.weight > 0)
        last = self._last
        if last is not None and self._is_cut(last.target, target):
            last, self.multiplier = None, Multiplier()
        direct = self._descended(target, exact_moments, last)
        moments = self.stage.transport.moments(direct)
        change = Change.fitted(target, direct + self.stage.transport.scattered(moments))
        if last is not None:
            change = last.change.moved_to(change, SMOOTHING)
        self._last = Solved(target, change, moments, last is None)
        return self._last

    def _is_cut(self, before: Array32, after: Array32) -> bool:
        moved = np.abs(np.log((after + DARK) / (before + DARK))).mean(axis=0)
        return float(np.vdot(moved, self.stage.weight)) > CUT

    def _descended(self, target: Array32, exact_moments: Array, last: Solved | None) -> Array32:
        """Direct light (3, h, w): from the exact solution, or from the last picture's change."""
        stage, transport = self.stage, self.stage.transport
        scattered = transport.scattered(exact_moments)
        exact = stage.limited(target - scattered)
        problem = stage.problem(target, self.settings.white_nits)
        most = problem.guard.of(transport.total(exact))[0] * self.settings.allowed
        if most <= NEGLIGIBLE:
            return exact
        descent = Descent(problem, scattered, self.multiplier)
        start, steps, rate = exact, STEPS, RATE
        if last is not None:
            wanted = last.change.gain * target + last.change.offset
            start = stage.limited(wanted - transport.scattered(last.moments))
            steps, rate = NEXT_STEPS, NEXT_RATE
        found = descent.run(start, most, steps, rate)
        return hue_limited(problem, transport.total(exact), found)
