"""The noise law: the variance of a camera's samples as a function of their level, and its fit.

Shot noise grows in proportion to the light and read noise does not, so the variance is a line in the
level (Healey and Kondepudy 1994, doi:10.1109/34.276126). Squared errors are sorted by level into equal
groups, averaged, and the line with non-negative coefficients is fitted to the averages.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import nnls

from procam.arrays import AnyArray, Array, IndexArray
from procam.maths.statistics import NORMAL_MAD
from procam.model.optics import Sensor

GROUPS, ROUNDS = 16, 4
MIN_GROUP = 100  # samples: with fewer, groups that are small by chance would pull the line down
CUT_SIGMAS = 3.0  # cut of outliers
CUT_MEAN = 0.97334  # mean square of a normal distribution within that cut
ROUNDING = 1 / 12  # variance of rounding to whole counts [DN^2]
MIN_VARIANCE = 1e-12


@dataclass(frozen=True, slots=True)
class NoiseLaw:
    """Variance of a sample of level I: `floor` + `per_level` I [image unit^2]."""

    floor: float
    per_level: float

    def variance(self, level: Any) -> Any:
        """Variance at `level`; never negative."""
        return np.maximum(self.floor + self.per_level * level, MIN_VARIANCE)


NO_NOISE = NoiseLaw(0.0, 0.0)


def noise_from_neighbours(pictures: Sequence[AnyArray], sensor: Sensor) -> NoiseLaw:
    """Noise law of the signal above black [DN] from single photographs (H, W).

    Second differences along rows cancel slopes. The screen's texture counts as noise, so the law is an
    upper bound.
    """
    levels, squares = [], []
    for counts in pictures:
        value = np.asarray(counts, float) - sensor.black_level
        left, centre, right = value[:, :-2], value[:, 1:-1], value[:, 2:]
        sound = np.maximum(np.maximum(left, centre), right) < sensor.full_scale
        levels.append(((left + centre + right) / 3)[sound])
        squares.append(((left - 2 * centre + right) ** 2 / 6)[sound])
    return _fit_robustly(np.concatenate(levels), np.concatenate(squares))


def noise_from_repeat(first: AnyArray, second: AnyArray, sensor: Sensor) -> NoiseLaw:
    """Noise law of the signal above black [DN] from two photographs (H, W) of one picture.

    A change of brightness between them does not count as noise.
    """
    a, b = (np.asarray(c, float) - sensor.black_level for c in (first, second))
    sound = np.maximum(a, b) < sensor.full_scale
    a, b = a[sound], b[sound]
    return _fit_robustly(*_level_and_square(a, b))


def noise_from_pairs(counts: Sequence[AnyArray], sensor: Sensor) -> NoiseLaw:
    """Noise law of the signal above black [DN] from a pattern, its inverse, another and its, (n,) each.

    Each pair adds up to white and black, whatever the stripes and their blur. The variance of a sum is
    that of two samples, at a level that is the sum of theirs.
    """
    light = [np.asarray(c, float) - sensor.black_level for c in counts]
    sound = np.max(light, axis=0) < sensor.full_scale
    p, p_inverse, q, q_inverse = (c[sound] for c in light)
    a, b = p + p_inverse, q + q_inverse
    level, square = _level_and_square(a, b)
    law = _fit_robustly(level, square, 2 * _rounding(np.ravel(light), level))
    return NoiseLaw(law.floor / 2, law.per_level)


def _level_and_square(a: Array, b: Array) -> tuple[Array, Array]:
    """Mean level (n,) of two pictures (n,) of the same, and the squares by which one sample is off."""
    ratio = float(a @ b) / max(float(b @ b), 1e-9)
    return 0.5 * (a + b), (a - ratio * b) ** 2 / (1 + ratio**2)


def fit_noise_law(level: Array, variance: Array) -> NoiseLaw:
    """Noise law from unbiased estimates (N,) of the variance at levels (N,), without outliers."""
    groups = _groups(level)
    return _line(
        np.array([level[g].mean() for g in groups]),
        np.maximum([variance[g].mean() for g in groups], MIN_VARIANCE),
    )


def _rounding(counts: Array, level: Array) -> Array:
    """Variance of rounding at levels (n,), by the steps between the counts (N,) that occur [DN^2].

    Counts that were decoded from photographs of 8 bits keep those steps, wide where it is bright, and
    photographs that are noiseless repeat their rounding.
    """
    known = np.unique(counts)
    if len(known) < 2:
        return np.full(level.shape, ROUNDING)
    return np.interp(level, known[1:], np.diff(known) ** 2 * ROUNDING)


def _fit_robustly(level: Array, square: Array, rounding: Array | float = ROUNDING) -> NoiseLaw:
    """Noise law from squared errors (N,) of counts, with edges and glints among them.

    Nowhere is the variance less than that of `rounding`, one or (N,). Each round cuts the errors at
    3 sigma of the law before it. That law also corrects for the growth of the variance within a group.
    """
    if not level.size:
        return NoiseLaw(ROUNDING, 0.0)
    groups = _groups(level)
    levels = np.array([level[g].mean() for g in groups])
    least = np.array([np.mean(np.broadcast_to(rounding, level.shape)[g]) for g in groups])
    law = NoiseLaw(1.0, 0.0)
    for number in range(ROUNDS):
        share = square / law.variance(np.maximum(level, 0))
        means = [_mean_square(share[g], coarse=number == 0) for g in groups]
        variances = means * law.variance(np.maximum(levels, 0))
        law = _line(levels, np.maximum(variances, least))
        law = NoiseLaw(max(law.floor, float(least.min())), law.per_level)
    return law


def _groups(level: Array) -> list[IndexArray]:
    """Indices of the samples in groups of equal size and rising level."""
    count = int(np.clip(level.size // MIN_GROUP, 1, GROUPS))
    return np.array_split(np.argsort(level), count)


def _mean_square(share: Array, coarse: bool) -> float:
    """Mean of squares near 1 without outliers; `coarse` by the median, which whole counts distort."""
    if coarse:
        return NORMAL_MAD**2 * float(np.median(share))
    kept = share[share < CUT_SIGMAS**2]
    return float(kept.mean()) / CUT_MEAN if kept.size else 1.0


def _line(levels: Array, variances: Array) -> NoiseLaw:
    """The law with the least relative errors of the variances at these levels; one is a constant."""
    if len(levels) == 1:
        return NoiseLaw(float(variances[0]), 0.0)
    design = np.stack([np.ones(len(levels)), np.maximum(levels, 0)], axis=1)
    (floor, slope), _ = nnls(design / variances[:, None], np.ones(len(levels)))
    return NoiseLaw(float(floor), float(slope))
