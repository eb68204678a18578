"""Solves some projectors of a rig whose screen, cameras and other projectors are known, and stay."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from procam.arrays import Array
from procam.estimate.geometry.adjustment import (
    Adjustment,
    RigProblem,
    prior_sigmas,
    systematic_ratio,
)
from procam.estimate.geometry.creases import widened_at_creases
from procam.estimate.geometry.fits import agreeing
from procam.estimate.geometry.model import (
    ParameterLayout,
    RigGeometry,
    residuals,
)
from procam.estimate.geometry.solve import (
    GROSS_SIGMAS,
    GeometrySolution,
    with_covariances,
)
from procam.estimate.geometry.start import check_projectors_placed, resect_projectors


def solve_projectors(
    problem: RigProblem, known: RigGeometry, names: Collection[str], *, main: str
) -> GeometrySolution:
    """Solve the poses and lenses of the projectors `names`, and of nothing else, for light by camera `main`.

    Their covariance is that of their own observations: errors of the screen and the cameras, which they
    share with the other projectors, are not in it.

    Raises
    ------
    CalibrationError
        If a projector is not seen well enough, or no pose explains what is seen.
    """
    problem = replace(
        problem,
        shape=known.shape,
        cameras=known.cameras,
        intrinsics=dict.fromkeys(known.cameras, "fixed"),
        fiducials=(),
        distances=(),
    )
    priors = {name: problem.projectors[name] for name in names}
    own = {pair: some for pair, some in problem.observations.items() if pair[1] in priors}
    placed = resect_projectors(known, priors, own)
    check_projectors_placed(placed, priors)
    rig = replace(known, projectors={**known.projectors, **placed.projectors})
    own = widened_at_creases(rig, own)
    prior = _held(problem, rig, names)
    rig = Adjustment(problem, own, prior).solve(rig, robust=True)
    last = Adjustment(problem, agreeing(rig, own), prior, names)
    rig = last.solve(rig, robust=False)
    covariance, _, scales = last.uncertainty(rig)
    solved = with_covariances(rig, covariance).projectors
    rig = replace(known, projectors={**known.projectors, **{name: solved[name] for name in names}})
    seen = agreeing(rig, problem.observations, GROSS_SIGMAS)
    errors = {pair: residuals(rig, pair, some) for pair, some in seen.items()}
    ratios = {
        pair: scales.get(pair) or systematic_ratio(errors[pair], some, rig.projectors[pair[1]].size)
        for pair, some in seen.items()
    }
    freedoms = np.zeros((0, len(prior)))
    on_sphere = float(np.sqrt(np.mean(np.square(list(ratios.values())))))
    return GeometrySolution(rig, covariance, seen, errors, ratios, freedoms, on_sphere, main)


def _held(problem: RigProblem, rig: RigGeometry, names: Collection[str]) -> Array:
    """Priors (P,) of the parameters of some projectors; 0, which holds them, for all others."""
    layout, prior = ParameterLayout.of(rig), prior_sigmas(problem, rig)
    held = np.zeros_like(prior)
    for name in names:
        held[layout.projectors[name]] = prior[layout.projectors[name]]
    return held
