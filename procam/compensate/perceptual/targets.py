"""Targets that projectors can reach, in place of content that would need negative light.

The exact solution (P) of such a target is the light that costs the eye least. A small picture is solved first
and its change carried over to the large one; still pictures are then solved at full size from there.
"""

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from procam.arrays import Array, Array32, Image, IndexArray
from procam.compensate.perceptual.bounds import (
    NEGLIGIBLE,
    Allowance,
    hue_limited,
    limited_places,
    mixed,
)
from procam.compensate.perceptual.descent import Descent
from procam.compensate.perceptual.light import Stage, interleaved, planes
from procam.compensate.perceptual.settings import Perceptual
from procam.compensate.perceptual.small_pictures import SmallPictures, Solved

STEPS, RATE = 20, 0.05  # of still pictures at full size
SAMPLE = 192  # cells along an edge of a movie's frame, one pixel of each is tried
SEED = 0  # of the pixels
RISE = 0.2  # of the share that is used, per frame, towards one that is larger
ROUNDS = 8  # of a sample's scattered light, each by half


@dataclass(frozen=True, eq=False, slots=True)
class Reached:
    """A target (N, N, 3) that (P) is to solve instead of a picture.

    `share` is how far the bounds let it go from the exact solution, 0, to the optimum, 1; `loss_db` what
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
        transport, target = self._stage.transport, planes(picture)
        problem = self._stage.problem(target, self._settings.white_nits)
        scattered = transport.scattered(exact_moments)
        exact = np.clip(target - scattered, problem.lo, problem.hi)
        first = transport.total(exact)
        most = problem.guard.of(first)[0] * self._settings.allowed
        if most <= NEGLIGIBLE:
            return Reached(picture)
        pictures = SmallPictures(self._small, self._settings)
        small = pictures.solve(picture, exact_moments)
        wanted = planes(small.change.of(picture)) - transport.scattered(small.moments)
        start = np.clip(wanted, problem.lo, problem.hi)
        found = Descent(problem, scattered, pictures.multiplier).run(start, most, STEPS, RATE)
        places = limited_places(exact, problem.lo, problem.hi, self._stage.weight)
        last = transport.total(hue_limited(problem, first, places, found))
        allowance = Allowance(
            partial(mixed, first, last), target, self._stage.weight, places, self._settings
        )
        share = allowance.share()
        total = mixed(first, last, share)
        if share == 0 or problem.contrast.value(total) >= problem.contrast.value(first):
            return Reached(picture)
        return Reached(interleaved(total), share, allowance.loss_db(share))


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
        allowance = self._allowance(picture, changed, (exact_moments, small.moments))
        share = self._share = self._smoothed(allowance.share(), small)
        if share == 0:
            return Reached(picture)
        loss_db = allowance.loss_db(share)
        if share < 1:  # in place: a frame of 8192 px is 0.8 GB
            changed -= picture
            changed *= np.float32(share)
            changed += picture
        return Reached(changed, share, loss_db)

    def _smoothed(self, allowed: float, small: Solved) -> float:
        """A share that is allowed, which does not jump up: that would flicker."""
        if small.moved is None or allowed <= self._share:
            return allowed
        return self._share + RISE * (allowed - self._share)

    def _allowance(self, picture: Image, changed: Image, moments: tuple[Array, Array]) -> Allowance:
        """Of a sample of a frame's pixels."""
        stage, edge = self._sample, len(picture)
        rows, columns = sampled_pixels(len(stage.weight), edge)
        ends = planes(picture[rows, columns]), planes(changed[rows, columns])
        solutions = SampledSolutions(stage, *ends, moments, {})
        return Allowance(
            solutions.total,
            ends[0],
            stage.weight,
            solutions.limited(),
            self._settings,
            is_sample=len(stage.weight) < edge,
        )


@cache
def sampled_pixels(count: int, edge: int) -> tuple[IndexArray, IndexArray]:
    """Rows and columns (C, C) of a random pixel in each of C x C cells; all pixels if they are as many."""
    cell = np.arange(count)
    within = np.random.default_rng(SEED).uniform(size=(2, count, count))
    rows = ((cell[:, None] + within[0]) * edge / count).astype(int)
    columns = ((cell + within[1]) * edge / count).astype(int)
    return rows, columns


@dataclass(frozen=True, eq=False)
class SampledSolutions:
    """Exact solutions of targets between a picture and a changed one, (3, h, w) each, of sampled pixels.

    `moments` (3, T) are those at both ends, about; `known` is the light that was solved, by share.
    """

    stage: Stage
    picture: Array32
    changed: Array32
    moments: tuple[Array, Array]
    known: dict[float, Array32]

    def limited(self) -> IndexArray:
        """Places at a limit in the picture's own solution, see `limited_places`."""
        limits = self.stage.limits(self.picture)
        return limited_places(self._direct(0.0), *limits, self.stage.weight)

    def total(self, share: float) -> Array32:
        """Total light (3, h, w)."""
        if share not in self.known:
            self.known[share] = self.stage.transport.total(self._direct(share))
        return self.known[share]

    def _direct(self, share: float) -> Array32:
        lo, hi = self.stage.limits(self.picture)
        asked = mixed(self.picture, self.changed, share)
        moments = self.moments[0] + share * (self.moments[1] - self.moments[0])
        for _ in range(ROUNDS):
            direct = np.clip(asked - self.stage.transport.scattered(moments), lo, hi)
            moments = (moments + self.stage.transport.moments(direct)) / 2
        return direct
