"""Single fits of a rig: robust, then of the observations that agree; and how good they are."""

from collections.abc import Mapping

import numpy as np

from procam.estimate.geometry.adjustment import (
    Adjustment,
    RigProblem,
    normalised_residuals,
    prior_sigmas,
    systematic_ratio,
)
from procam.estimate.geometry.model import Observations, Pair, RigGeometry, residuals
from procam.maths.statistics import robust_sigma_2d

OUTLIER_SIGMAS = 6.0


def robustly(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """A robust fit."""
    return Adjustment(problem, seen, prior_sigmas(problem, rig)).solve(rig, robust=True)


def fitted(problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry) -> RigGeometry:
    """A robust fit, then a plain one of the observations that agree."""
    rig = robustly(problem, seen, rig)
    fit = Adjustment(problem, agreeing(rig, seen), prior_sigmas(problem, rig))
    return fit.solve(rig, robust=False)


def mean_ratio(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> float:
    """Root mean square of the pairs' systematic ratios, without outliers."""
    ratios = [
        systematic_ratio(residuals(rig, p, o), o, rig.projectors[p[1]].size)
        for p, o in agreeing(rig, seen).items()
    ]
    return float(np.sqrt(np.mean(np.square(ratios))))


def agreeing(
    rig: RigGeometry, seen: Mapping[Pair, Observations], sigmas: float = OUTLIER_SIGMAS
) -> dict[Pair, Observations]:
    """Observations without outliers, by the robust sigma of their pair."""
    kept = {}
    for pair, some in seen.items():
        error = normalised_residuals(residuals(rig, pair, some), some)
        kept[pair] = some.some(error < sigmas * max(robust_sigma_2d(error), 1.0))
    return kept
