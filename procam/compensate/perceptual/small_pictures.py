"""Solutions of small pictures, each from that of the one before, as changes for large ones."""

from dataclasses import dataclass, field, replace

import numpy as np

from procam.arrays import Array, Array32, Image
from procam.compensate.perceptual.bounds import (
    NEGLIGIBLE,
    hue_limited,
    largest,
    limited_places,
    mixed,
)
from procam.compensate.perceptual.descent import Descent, Multiplier, Problem
from procam.compensate.perceptual.guided import Change
from procam.compensate.perceptual.light import Stage, planes
from procam.compensate.perceptual.settings import Perceptual
from procam.maths.warp import reduced_to

REDUCTION = 4  # of a picture's edge
STEPS, RATE = 25, 0.12  # of the first picture
NEXT_STEPS, NEXT_RATE = 4, 0.05  # of those after it
SMOOTHING = 0.5  # share of a new picture in the change that is used
CUT = 0.5  # mean change of the logarithm of light from picture to picture that is a cut
OTHER = 2.5  # the same at a place that shows something else
STILL = 0.02  # the same of a picture that moves; of less, steps are smaller in proportion
DARK = np.float32(1e-3)  # light [rel] added before that logarithm
START_HALVINGS = 3


@dataclass(frozen=True, eq=False)
class Solved:
    """A small picture (3, h, w), how it is changed, and the moments (3, T) of its direct light.

    `moved` (h, w): change of the logarithm of light since the picture before; None if there was none, or one
    of another scene.
    """

    target: Array32
    change: Change
    moments: Array
    moved: Array32 | None


@dataclass(eq=False)
class SmallPictures:
    """Pictures reduced to the size of a stage; `multiplier` is the guard's after the last one."""

    stage: Stage
    settings: Perceptual
    multiplier: Multiplier = field(default_factory=Multiplier)
    _last: Solved | None = None

    def solve(self, picture: Image, exact_moments: Array) -> Solved:
        """Solve a picture (N, N, 3) whose exact solution has moments (3, T)."""
        target = planes(reduced_to(picture, self.stage.weight.shape))
        moved = None if self._last is None else self._moved(self._last.target, target)
        if moved is None or float(np.vdot(moved, self.stage.weight)) > CUT:
            self._last, self.multiplier, moved = None, Multiplier(), None
        if self._last is not None and moved is not None and not moved.any():
            return replace(self._last, moved=moved)
        self._last = self._solved(target, exact_moments, moved)
        return self._last

    def _moved(self, before: Array32, after: Array32) -> Array32:
        """(h, w) mean over colours of the change of the logarithm of light, where light counts."""
        logs = [np.log(light + DARK) for light in (before, after)]
        return np.abs(logs[1] - logs[0]).mean(axis=0) * (self.stage.weight > 0)

    def _solved(self, target: Array32, exact_moments: Array, moved: Array32 | None) -> Solved:
        transport = self.stage.transport
        problem = self.stage.problem(target, self.settings.white_nits)
        scattered = transport.scattered(exact_moments)
        exact = np.clip(target - scattered, problem.lo, problem.hi)
        direct = self._direct(problem, target, exact, moved)
        moments = transport.moments(direct)
        change = Change.fitted(target, direct + transport.scattered(moments))
        if moved is not None:
            assert self._last is not None
            share = np.where(moved > OTHER, np.float32(1), np.float32(SMOOTHING))
            change = self._last.change.moved_to(change, share)
        return Solved(target, change, moments, moved)

    def _direct(
        self, problem: Problem, target: Array32, exact: Array32, moved: Array32 | None
    ) -> Array32:
        """Direct light (3, h, w), no worse in contrast than the exact solution's."""
        total = problem.transport.total(exact)
        most = problem.guard.of(total)[0] * self.settings.allowed
        if most <= NEGLIGIBLE:
            return exact
        start, steps, rate = exact, STEPS, RATE
        if moved is not None:
            motion = float(np.vdot(moved, self.stage.weight))
            start, steps = self._start(problem, target, exact, moved, most), NEXT_STEPS
            rate = NEXT_RATE * min(1.0, motion / STILL)
        found = Descent(problem, total - exact, self.multiplier).run(start, most, steps, rate)
        places = limited_places(exact, problem.lo, problem.hi, self.stage.weight)
        found = hue_limited(problem, total, places, found)
        contrasts = [
            problem.contrast.value(light) for light in (total, problem.transport.total(found))
        ]
        return found if contrasts[1] < contrasts[0] else exact

    def _start(
        self, problem: Problem, target: Array32, exact: Array32, moved: Array32, most: float
    ) -> Array32:
        """Direct light that the last change leads to, where the same is shown, and within the guard."""
        assert self._last is not None
        wanted = self._last.change.gain * target + self._last.change.offset
        scattered = self.stage.transport.scattered(self._last.moments)
        warm = np.where(moved > OTHER, exact, np.clip(wanted - scattered, problem.lo, problem.hi))

        def holds(share: float) -> bool:
            return problem.guard.of(problem.transport.total(mixed(exact, warm, share)))[0] <= most

        return mixed(exact, warm, largest(holds, START_HALVINGS))
