"""Where cameras and projectors stand and how they are built, from what cameras see (science.md s.3)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError
from procam.estimate.geometry.adjustment import (
    Adjustment,
    RigProblem,
    prior_of,
    robust_sigma,
    scores,
    systematic_ratio,
)
from procam.estimate.geometry.fiducial_checks import check_marks
from procam.estimate.geometry.fiducials import turned_to_fiducials
from procam.estimate.geometry.model import (
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    residuals,
)
from procam.estimate.geometry.start import (
    check_complete,
    first_rigs,
    placed_by_marks,
    resect_projectors,
    with_camera,
)
from procam.maths.geometry.ray_to_screen import shape_coefficient_count
from procam.model.optics import CameraModel, ProjectorModel

Array = NDArray[np.float64]
FEW = 1500  # observations of each pair in the first rounds
ROUGH = 300  # observations of each pair for a start
TRIES = (8, 4, 2, 1)  # places of the first camera that are followed further, ever fewer
MOST_BUMPY = 5000  # where the screen is no sphere, it is not noise that counts
OUTLIER_SIGMAS = 6.0
GROSS_SIGMAS = 40.0  # a panel lit at a grazing angle may be far off the model, and yet be right
APART = 0.05  # of the radius, between two cameras, from which on they tell of bumps
ROUND_ENOUGH = 1.5  # excess of the residuals on a sphere that is good enough
DEGREES = (6, 8)  # tried in turn; fewer explain little of a dome made of panels
EXPLAINS = 0.9  # of the excess, at most, that more harmonics must leave


@dataclass(frozen=True, slots=True)
class GeometrySolution:
    """A solved rig.

    Attributes
    ----------
    rig : screen, cameras and projectors. covariance : (P, P) of its parameters in the order of
        `ParameterLayout`, 0 for those that were fixed and along freedoms that nothing fixes.
    observations : those that agree. residual_px : (N, 2) what is left of each.
    scale : by how much the residuals of each pair exceed their standard errors [-].
    freedoms : (F, P) directions that nothing fixes, of unit length in scaled parameters.
    sphere_excess : by how much means over cells exceed their standard errors on an exact sphere [-].
    given : projectors whose directions are known beforehand, not solved, and how well [arcmin].
    """

    rig: RigGeometry
    covariance: Array
    observations: Mapping[Pair, Observations]
    residual_px: Mapping[Pair, Array]
    scale: Mapping[Pair, float]
    freedoms: Array
    sphere_excess: float
    given: Mapping[str, float] = field(default_factory=dict)

    @property
    def main(self) -> str:
        """The camera that sees most."""
        return _by_most_seen(self.rig.cameras, self.observations)[0]

    @property
    def camera(self) -> CameraModel:
        """The main camera, placed."""
        return self.rig.cameras[self.main]

    @property
    def projectors(self) -> Mapping[str, ProjectorModel]:
        """The projectors by name."""
        return self.rig.projectors


def solve_geometry(problem: RigProblem) -> GeometrySolution:
    """Cameras, projectors and, where they tell of it, the screen's bumps; needs no start values.

    First in the camera's own axes, on a part of the observations with little trust in any of them;
    then turned to the fiducials, at last on all that agree. An exact sphere is tried first, then more
    and more harmonics as long as they explain more. A mesh stays as it is; the first camera is placed
    on it by four fiducials or more.
    """
    _check_finite(problem.observations)
    few = {pair: some.thinned(FEW) for pair, some in problem.observations.items()}
    rig = _fitted(problem, few, _in_place(problem, few))
    on_sphere = _mean_excess(rig, few)
    rig = _bumped(problem, few, rig) if _bends(problem, rig) else rig
    used = problem.observations
    if not rig.shape.exact:
        used = {pair: some.thinned(MOST_BUMPY) for pair, some in used.items()}
    last = Adjustment(problem, _agreeing(rig, used), prior_of(problem, rig))
    rig = last.solve(rig, robust=False)
    check_marks(rig, problem.fiducials, problem.distances, rough=on_sphere > ROUND_ENOUGH)
    seen = _agreeing(rig, problem.observations, GROSS_SIGMAS)
    covariance, freedoms, scales = last.certainty(rig)
    left = {pair: residuals(rig, pair, some) for pair, some in seen.items()}
    rig = _with_covariances(rig, covariance)
    return GeometrySolution(rig, covariance, seen, left, scales, freedoms, on_sphere)


def _bumped(problem: RigProblem, few: Mapping[Pair, Observations], rig: RigGeometry) -> RigGeometry:
    """The rig with as many harmonics of the screen as explain what an exact sphere leaves."""
    for degree in DEGREES:
        excess = _mean_excess(rig, few)
        if excess < ROUND_ENOUGH or degree > problem.most_degree:
            break
        bumps = np.zeros(shape_coefficient_count(degree))
        bumps[: rig.shape.bumps.size] = rig.shape.bumps
        shape = replace(rig.shape, bumps=bumps, degree=degree)
        bent = _fitted(problem, few, RigGeometry(shape, rig.cameras, rig.projectors))
        if _mean_excess(bent, few) > EXPLAINS * excess:
            break
        rig = bent
    return rig


def _check_finite(observations: Mapping[Pair, Observations]) -> None:
    for (camera, projector), some in observations.items():
        lost = ~np.isfinite(np.c_[some.camera_px, some.projector_px, some.sigma_px]).all(axis=1)
        if lost.any():
            raise InputError(
                f"observations: got NaN or infinity in {lost.sum()} of {lost.size} that {camera} has of "
                f"{projector}, expected pixels and their errors; leave out what was not seen"
            )


def _with_covariances(rig: RigGeometry, covariance: Array) -> RigGeometry:
    blocks = ParameterLayout.of(rig).projectors
    projectors = {
        name: replace(p, covariance=covariance[blocks[name], blocks[name]])
        for name, p in rig.projectors.items()
    }
    return RigGeometry(rig.shape, rig.cameras, projectors)


def _in_place(problem: RigProblem, few: Mapping[Pair, Observations]) -> RigGeometry:
    """All devices near their places in the dome's frame."""
    free = replace(problem, fiducials=(), distances=())
    turns = problem.shape.exact  # turned about its centre, a sphere looks the same
    start = _started(free, few) if turns else _started_by_marks(problem, few)
    rig = _fitted(free, few, start)
    marks = problem.fiducials, problem.distances
    check_marks(rig, *marks, rough=True, size_known=problem.radius_known)
    return turned_to_fiducials(rig, problem.fiducials) if turns else rig


def _started_by_marks(problem: RigProblem, few: Mapping[Pair, Observations]) -> RigGeometry:
    """All devices near their places on a screen that is no sphere."""
    camera = placed_by_marks(problem.cameras, problem.shape, problem.fiducials)
    alone = RigGeometry(problem.shape, {camera.name: camera}, {})
    return _with_others(problem, few, resect_projectors(alone, problem.hung, few))


def _started(problem: RigProblem, seen: Mapping[Pair, Observations]) -> RigGeometry:
    """All devices near their places, in the axes of the camera that sees most.

    It and an exact sphere tell of everything it sees, if it starts well enough.
    """
    first = _by_most_seen(problem.cameras, seen)[0]
    rigs = first_rigs(problem.cameras[first], problem.shape, problem.hung, seen)
    for most in TRIES:
        rigs = _best_first(problem, seen, rigs[:most])
        if _mean_excess(rigs[0], _visible(rigs[0], seen)) < ROUND_ENOUGH:
            break
        # a projector that began too far off is found anew from where the camera is by now
        rigs = [resect_projectors(rig, problem.hung, seen) for rig in rigs]
    return _with_others(problem, seen, rigs[0])


def _with_others(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """The rig with camera after camera, each time with what is known by then."""
    rig = _roughly(problem, seen, rig)
    for name in _by_most_seen(problem.cameras, seen):
        if name not in rig.cameras:
            rig = with_camera(rig, problem.cameras[name], problem.hung, seen)
            rig = _roughly(problem, seen, rig)
    check_complete(rig, problem.hung)
    return rig


def _by_most_seen(cameras: Iterable[str], seen: Mapping[Pair, Observations]) -> list[str]:
    """Cameras, the one that sees most first."""
    counts = {n: sum(len(o.sigma_px) for (c, _), o in seen.items() if c == n) for n in cameras}
    return sorted(counts, key=lambda name: -counts[name])


def _best_first(
    problem: RigProblem, seen: Mapping[Pair, Observations], starts: Sequence[RigGeometry]
) -> list[RigGeometry]:
    """Rigs after a few more rounds, best first; one that fits ends the search."""
    tried: list[tuple[float, RigGeometry]] = []
    for start in starts:
        rig = _roughly(problem, seen, start)
        tried.append((_mean_excess(rig, _visible(rig, seen)), rig))
        if tried[-1][0] < ROUND_ENOUGH:
            return [rig]
    return [rig for _, rig in sorted(tried, key=lambda each: each[0])]


def _roughly(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """A few robust rounds on the devices placed so far."""
    few = {pair: some.thinned(ROUGH) for pair, some in _visible(rig, seen).items()}
    return Adjustment(problem, few, prior_of(problem, rig)).solve(rig, robust=True)


def _visible(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> dict[Pair, Observations]:
    return {(c, p): o for (c, p), o in seen.items() if c in rig.cameras and p in rig.projectors}


def _fitted(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """Robust rounds, then plain ones on what agrees."""
    prior = prior_of(problem, rig)
    rig = Adjustment(problem, seen, prior).solve(rig, robust=True)
    return Adjustment(problem, _agreeing(rig, seen), prior).solve(rig, robust=False)


def _bends(problem: RigProblem, rig: RigGeometry) -> bool:
    """Whether the screen may be solved for: two cameras stand so far apart that they tell of depth."""
    if not problem.shape.exact:
        return False
    places = [c.camera_from_dome.origin for c in rig.cameras.values() if c.camera_from_dome]
    steps = [np.linalg.norm(a - b) for a, b in combinations(places, 2)]
    return bool(max(steps, default=0.0) > APART * rig.shape.radius_m)


def _mean_excess(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> float:
    """Root mean square over pairs of what agrees; misread patches would hide a rig that is right."""
    agreeing = _agreeing(rig, seen)
    return float(np.sqrt(np.mean([systematic_ratio(rig, p, o) ** 2 for p, o in agreeing.items()])))


def _agreeing(
    rig: RigGeometry, seen: Mapping[Pair, Observations], sigmas: float = OUTLIER_SIGMAS
) -> dict[Pair, Observations]:
    """Observations without those far outside the crowd of their pair."""
    kept = {}
    for pair, some in seen.items():
        error = scores(rig, pair, some)
        kept[pair] = some.some(error < sigmas * max(robust_sigma(error), 1.0))
    return kept
