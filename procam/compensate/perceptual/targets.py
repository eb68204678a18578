"""Targets that projectors can reach, in place of content that would need negative light.

The exact solution (P) of such a target is the light that costs the eye least. A small picture is solved first
and its change carried over to the large one; still pictures are then solved at full size from there.
"""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Image
from procam.compensate.perceptual.bounds import NEGLIGIBLE, SampledWay, Way, hue_limited, mixed
from procam.compensate.perceptual.descent import Descent
from procam.compensate.perceptual.light import Stage, interleaved, planes
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.small_pictures import SmallPictures

STEPS, RATE = 20, 0.05  # of still pictures at full size
SAMPLE = 256  # pixels along an edge of a movie's frame that are tried
RISE = 0.2  # of the share that is used, per frame, towards one that is larger


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
        light = transport.total(exact)
        ends = light, transport.total(hue_limited(problem, light, found))
        way = Way(problem, *ends, self._settings.allowed)
        share = way.length()
        if share == 0:
            return Reached(picture)
        return Reached(interleaved(mixed(*ends, share)), share, way.loss_db(share))


class MovieTargets:
    """Targets of frames in their order.

    Parameters
    ----------
    small : for pictures of a quarter of the frames' edge. sample : for `SAMPLE` pixels along an edge, or all.
    """

    def __init__(self, small: Stage, sample: Stage, settings: Perceptual) -> None:
        self._pictures = SmallPictures(small, settings)
        self._sample, self._settings, self._share = sample, settings, 0.0

    def of(self, picture: Image, exact_moments: Array) -> Reached:
        """A target for a frame (N, N, 3) whose exact solution has moments (3, T)."""
        small = self._pictures.solve(picture, exact_moments)
        changed = small.change.of(picture)
        count, edge = len(self._sample.weight), len(picture)
        at = ((np.arange(count) + 0.5) * edge / count).astype(int)
        ends = planes(picture[np.ix_(at, at)]), planes(changed[np.ix_(at, at)])
        sampled = SampledWay(
            self._sample, *ends, (exact_moments, small.moments), self._settings, count == edge
        )
        share = self._share = self._smoothed(sampled.length(), small.is_first)
        if share == 0:
            return Reached(picture)
        target = changed if share == 1 else mixed(picture, changed, share)
        return Reached(target, share, sampled.loss_db(share))

    def _smoothed(self, allowed: float, is_first: bool) -> float:
        """A share that is allowed, which does not jump up: that would flicker."""
        if is_first or allowed <= self._share:
            return allowed
        return self._share + RISE * (allowed - self._share)
