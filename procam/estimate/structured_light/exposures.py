"""Photographs of a set that were exposed differently from its white, and by what factor.

A pattern and its inverse add up to white and black, and so do equal steps of a sinusoid, in every pixel
and at any blur. The factors of such a group follow from that sum by least squares over the pixels
(docs/theory/structured-light.md (S7)); other patterns are compared with white by their brightest and
darkest pixels. Photographs in a row with like factors share the median of theirs.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray
from procam.estimate.structured_light.codes import Code, Plane
from procam.estimate.structured_light.consistency import Order
from procam.estimate.structured_light.level_checks import ProbedSet

JUMP = 0.06  # relative change of exposure that counts, of patterns that add up to white
SINGLE_JUMP = 0.2  # of others: blur and the part of the panel in view matter too
FEWEST = 200  # samples that determine the factors of a group
RIDGE = 1e-3  # weight of a factor of 1, per sample
MOST_MISS = 0.05  # mean departure of a group's sum from white and black: above, it is no such group
EQUAL = 1e-6  # difference of phasors of equal steps
HIGH, LOW = 95, 5  # percentiles: brightest and darkest pixels
MOST_DARK, LEAST_DARK = 0.35, 0.7  # of the brightest: a pattern with both levels; with bright alone
LEAST_BRIGHT = 0.3  # of white: darker pictures have no measurable exposure


def relative_exposures(code: Code, photos: ProbedSet, order: Order) -> Array:
    """Exposure of each photograph (n,) over that of white; 1 where it differs by a few percent at most.

    `order` has white and black; photographs that it leaves out have a factor of 1.
    """
    shown = {i: photo for i, photo in enumerate(order) if photo is not None}
    light = _Light(photos, shown[0], shown[1])
    found, slack = np.full((2, len(photos.probes)), np.nan)
    for plane, photo in shown.items():
        if plane > 1:
            found[photo] = light.factor(photo, stripes=code.planes[plane].kind == "binary")
            slack[photo] = np.log1p(SINGLE_JUMP)
    for group in _groups(code):
        taken = [shown[plane] for plane in group if plane in shown]
        factors = light.factors(taken) if len(taken) == len(group) else np.array(np.nan)
        if np.isfinite(factors).all():
            found[taken], slack[taken] = factors, np.log1p(JUMP)
    return _by_runs(found, slack, [photo for plane, photo in shown.items() if plane > 1])


def exposure_notes(gains: Array, names: Sequence[str], white: int) -> list[str]:
    """A line for each run of photographs with a factor (n,) that is not 1."""
    edges = [0, *(np.flatnonzero(np.diff(gains)) + 1).tolist(), len(gains)]
    return [
        f"{names[first]}{f' to {names[end - 1]}' if end - first > 1 else ''}: exposed "
        f"{gains[first]:.2f} times as much as white, {names[white]}; scaled to it, but keep the "
        "camera's exposure manual"
        for first, end in pairwise(edges)
        if gains[first] != 1
    ]


def scaled(image: AnyArray, black: AnyArray, gain: float) -> AnyArray:
    """A photograph as it would be with the exposure of white, from its own, `gain` times as much."""
    base = np.asarray(black, np.float32)
    return np.asarray(base + (image - base) / np.float32(gain), np.float32)


class _Light:
    """Light of each photograph between black, 0, and white, 1, in the lit samples."""

    def __init__(self, photos: ProbedSet, white: int, black: int) -> None:
        span = photos.probes[white] - photos.probes[black]
        self._lit = photos.lit & (span > 0.25 * photos.range) & (photos.probes[white] < photos.top)
        self._photos, self._black, self._span = photos, black, span

    def of(self, photo: int, where: BoolArray) -> AnyArray:
        """Light (n,) in the samples `where`."""
        above = self._photos.probes[photo] - self._photos.probes[self._black]
        return np.asarray((above / np.where(where, self._span, 1))[where])

    def factors(self, group: Sequence[int]) -> Array:
        """Exposures (N,) of photographs whose patterns add up to N / 2 of white; NaN if they do not."""
        clear = np.all([self._photos.probes[i] < self._photos.top for i in group], axis=0)
        where = self._lit & clear
        if where.sum() < FEWEST:
            return np.full(len(group), np.nan)
        light = np.stack([self.of(i, where) for i in group], axis=1).astype(float)
        total, ridge = len(group) / 2, RIDGE * len(light) * np.eye(len(group))
        inverse = np.linalg.solve(
            light.T @ light + ridge, light.sum(axis=0) * total + ridge.sum(axis=0)
        )
        miss = np.mean(np.abs(light @ inverse - total)) / total
        sound = miss < MOST_MISS and inverse.min() > 0
        return 1 / inverse if sound else np.full(len(group), np.nan)

    def factor(self, photo: int, *, stripes: bool) -> float:
        """Exposure of one photograph from its brightest and darkest samples; NaN if they are not seen."""
        if self._lit.sum() < FEWEST:
            return np.nan
        low, high = np.percentile(self.of(photo, self._lit), [LOW, HIGH])
        if high < LEAST_BRIGHT:
            return np.nan
        if low < MOST_DARK * high:
            return float(max(low, 0) + high)
        return float(high) if stripes and low > LEAST_DARK * high else np.nan


def _groups(code: Code) -> list[list[int]]:
    """Planes that add up to half as much white as they are: pairs of stripes, fewest equal steps."""
    alike: dict[Plane, list[int]] = {}
    for number, plane in enumerate(code.planes):
        if plane.axis:
            alike.setdefault(replace(plane, inverse=False, shift=0.0), []).append(number)
    groups: list[list[int]] = []
    for planes in alike.values():
        planes.sort(key=lambda i: code.planes[i].shift % (2 * np.pi))
        every = _fewest([code.planes[i] for i in planes])
        groups += [planes[first::every] for first in range(every)]
    return groups


def _fewest(planes: Sequence[Plane]) -> int:
    """Distance in a list, sorted by shift, of planes that add up; 0 if they do not."""
    if planes[0].kind == "binary":
        return int(len(planes) == 2)
    count = len(planes)
    phasors = np.exp(1j * count * np.array([plane.shift for plane in planes]))
    if np.abs(phasors - phasors[0]).max() > EQUAL or count < 2:
        return 0
    return count // next(part for part in range(2, count + 1) if count % part == 0)


def _by_runs(found: Array, slack: Array, photos: Sequence[int]) -> Array:
    """Factors (n,) in which photographs in a row with like ones share their median.

    Like are logarithms that differ by less than `slack` (n,). Unknown factors are those of the photograph
    before, or of the first known one.
    """
    logs = np.log(np.where(found > 0, found, np.nan))
    runs: list[list[int]] = []
    middle = np.nan
    for photo in sorted(photos):
        if runs and not abs(logs[photo] - middle) >= slack[photo]:  # true for NaN
            runs[-1].append(photo)
        else:
            runs.append([photo])
        known = [i for i in runs[-1] if np.isfinite(logs[i])]
        middle = float(np.median(logs[known])) if known else np.nan
    gains = np.ones(len(found))
    for run in runs:
        known = [i for i in run if np.isfinite(logs[i])]
        if known and abs(np.median(logs[known])) >= min(slack[known]):
            gains[run] = np.exp(np.median(logs[known]))
    return gains
