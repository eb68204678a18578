"""Targets that projectors can reach, in place of content that would need negative light.

The exact solution (P) of such a target is the light that costs the eye least. A small picture is solved first
and its change carried over to the large one; still pictures are then solved at full size from there.
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Array32, Image
from procam.compensate.perceptual.descent import Descent, Problem
from procam.compensate.perceptual.light import Stage, interleaved, planes
from procam.compensate.perceptual.objective import luma
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.small_pictures import NEGLIGIBLE, SmallPictures
from procam.maths.vision.pu21 import pu21_table

STEPS, RATE = 12, 0.05  # of still pictures at full size
BISECTIONS = 10
SHARES = (1.0, 0.8, 0.6, 0.4, 0.2)  # of the change of a movie's frame, until the guard holds
SAMPLE = 256  # pixels along an edge for that
CERTAIN = 2.0  # standard errors by which it must hold
ROUNDS = 8


@dataclass(frozen=True, eq=False, slots=True)
class Reached:
    """A target (N, N, 3) that (P) is to solve instead of a picture.

    `share` is how far the guard let it go from the exact solution, 0, to the optimum, 1; `loss_db` what
    that costs in luminance, see `Perceptual.db`; of a movie's frame, as a sample of its pixels has it.
    """

    target: Image
    share: float = 0.0
    loss_db: float = 0.0


class StillTargets:
    """Targets of pictures that have nothing to do with each other.

    Parameters
    ----------
    stage : for the pictures. small : of the same, for pictures of a quarter of their edge.
    """

    def __init__(self, stage: Stage, small: Stage, settings: Perceptual) -> None:
        self._stage, self._small, self._settings = stage, small, settings

    def of(self, picture: Image, exact_moments: Array) -> Reached:
        """A target for a picture (N, N, 3) whose exact solution has moments (3, T)."""
        stage, transport = self._stage, self._stage.transport
        target, scattered = planes(picture), transport.scattered(exact_moments)
        exact = stage.limited(target - scattered)
        problem = stage.problem(target * (stage.weight > 0), self._settings.white_nits)
        most = problem.guard.of(transport.total(exact))[0] * self._settings.allowed
        if most <= NEGLIGIBLE:
            return Reached(picture)
        pictures = SmallPictures(self._small, self._settings)
        small = pictures.solve(picture, exact_moments)
        wanted = planes(small.change.of(picture))
        start = stage.limited(wanted - transport.scattered(small.moments))
        found = Descent(problem, scattered, pictures.multiplier).run(start, most, STEPS, RATE)
        ends = transport.total(exact), transport.total(found)
        share = guarded(problem, *ends, self._settings.allowed)
        if share == 0:
            return Reached(picture)
        total = mixed(*ends, share)
        errors = [problem.guard.luminance(luma(light)) for light in (ends[0], total)]
        return Reached(interleaved(total), share, _loss_db(*errors))


def mixed(first: Array32, last: Array32, share: float) -> Array32:
    """Light on the way between two pictures."""
    return first + np.float32(share) * (last - first)


def guarded(problem: Problem, first: Array32, last: Array32, allowed: float) -> float:
    """How far from the exact solution's total light, `first`, the error of luminance lets it go.

    If that does not bring contrast nearer to the target's, 0.
    """
    ends = luma(first), luma(last)
    most = problem.guard.luminance(ends[0]) * allowed

    def holds(share: float) -> bool:
        return problem.guard.luminance(mixed(*ends, share)) <= most

    low, high = (1.0, 1.0) if holds(1.0) else (0.0, 1.0)
    for _ in range(BISECTIONS if low < high else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    total = mixed(first, last, low)
    better = problem.contrast.of(total)[0] < problem.contrast.of(first)[0]
    return low if better else 0.0


def _loss_db(before: float, after: float) -> float:
    return float(10 * np.log10(after / before))


class MovieTargets:
    """Targets of frames in their order.

    Parameters
    ----------
    small : for pictures of a quarter of the frames' edge. sample : for `SAMPLE` pixels along an edge, or all.
    """

    def __init__(self, small: Stage, sample: Stage, settings: Perceptual) -> None:
        self._pictures = SmallPictures(small, settings)
        self._sample, self._settings = sample, settings

    def of(self, picture: Image, exact_moments: Array) -> Reached:
        """A target for a frame (N, N, 3) whose exact solution has moments (3, T)."""
        small = self._pictures.solve(picture, exact_moments)
        changed = small.change.of(picture)
        share, loss_db = self._share(picture, changed, (exact_moments, small.moments))
        if share == 0:
            return Reached(picture)
        if share < 1:
            changed = mixed(picture, changed, share)
        return Reached(changed, share, loss_db)

    def _share(
        self, picture: Image, changed: Image, moments: tuple[Array, Array]
    ) -> tuple[float, float]:
        """The largest share of a change with which the guard holds, as far as a sample can tell; its loss."""
        count, edge = len(self._sample.weight), len(picture)
        at = ((np.arange(count) + 0.5) * edge / count).astype(int)
        ends = planes(picture[np.ix_(at, at)]), planes(changed[np.ix_(at, at)])
        weight, exact = self._sample.weight, self._errors(ends, moments, 0.0)
        before = float(np.vdot(weight, exact))
        for share in SHARES if before > NEGLIGIBLE else ():
            errors = self._errors(ends, moments, share)
            above = errors - exact * self._settings.allowed
            mean = float(np.vdot(weight, above))
            sigma = float(np.linalg.norm(weight * (above - mean))) if count < edge else 0.0
            if mean + CERTAIN * sigma <= 0:
                return share, _loss_db(
                    float(np.vdot(weight, exact)), float(np.vdot(weight, errors))
                )
        return 0.0, 0.0

    def _errors(
        self, ends: tuple[Array32, Array32], moments: tuple[Array, Array], share: float
    ) -> Array32:
        """Squared errors of luminance (h, w) [PU21 units squared] of the sample's exact solution."""
        stage, white = self._sample, np.float32(self._settings.white_nits)
        asked = mixed(*ends, share)
        known = moments[0] + share * (moments[1] - moments[0])
        for _ in range(ROUNDS):
            direct = stage.limited(asked - stage.transport.scattered(known))
            known = (known + stage.transport.moments(direct)) / 2
        seen = pu21_table()(luma(stage.transport.total(direct)) * white)[0]
        return (seen - pu21_table()(luma(ends[0]) * white)[0]) ** 2
