"""Poses and lenses of cameras and projectors, and the screen's shape, from observations.

The solve needs no start values (docs/theory/geometry.md). It starts one camera, adds the others in
the order of what they see, and fits the rig as an exact sphere in the first camera's axes. Then it
rotates the rig to the fiducials, adds harmonics of the screen as long as they explain more, and
ends with all observations that agree. The module is longer than 300 lines because every stage
is one of the steps of that one solve.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from procam.arrays import Array
from procam.errors import CalibrationError, DidNotConverge, InputError
from procam.estimate.geometry.adjustment import (
    Adjustment,
    Intrinsics,
    RigProblem,
    prior_sigmas,
    square_rows,
)
from procam.estimate.geometry.creases import widened_at_creases
from procam.estimate.geometry.fiducial_checks import check_fiducials
from procam.estimate.geometry.fiducials import loosened, rotated_to_fiducials
from procam.estimate.geometry.fits import agreeing, fitted, mean_ratio, robustly
from procam.estimate.geometry.model import (
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    residuals,
)
from procam.estimate.geometry.start import (
    add_camera,
    check_projectors_placed,
    initial_rigs,
    resect_camera,
    resect_projectors,
)
from procam.estimate.geometry.walls import with_walls
from procam.maths.geometry.ray_to_screen import shape_coefficient_count
from procam.maths.mesh.shape import MeshShape
from procam.model.optics import CameraModel, Distance, Fiducial, ProjectorModel

FEW = 1500  # observations of each pair in the first fits
ROUGH = 300  # observations of each pair for a start
TRIES = (8, 4, 2, 1)  # start positions of the first camera that each round keeps
MOST_NOT_SPHERE = 5000  # per pair in the last fit of a screen whose shape, not noise, dominates
GROSS_SIGMAS = 40.0  # kept in the result: the model may be this far off where light grazes
MAX_SPHERE_RATIO = 1.5  # systematic ratio up to which the screen counts as a sphere
# systematic ratio with marks over that without, from which they bend the lens: right marks make it 1.06
# where the lens is hardly determined, one 3 degrees off 2.7
BENT = 1.5
DEGREES = (6, 8)  # of harmonics, in turn; lower ones explain little of a dome made of panels
NOT_SQUARE = 4.0  # standard errors by which panels' pixels must differ from squares
MOVES = 1e-4  # of all that a freedom moves, from which a camera moves with it
WALLS_OFF_M = 0.03  # of a room, as drawings of rooms are
EXPLAINS = 0.9  # harmonics are kept if they reduce the systematic ratio to this share
# with one camera, to which a lens that is not of the fitted kind looks like a deformation: deformations
# leave 0.25 to 0.45 of the ratio, and lenses that ripple by 0.1 px leave 0.8 or more
EXPLAINS_ALONE = 0.5


@dataclass(frozen=True, slots=True)
class GeometrySolution:
    """A solved rig.

    Attributes
    ----------
    rig : screen, cameras and projectors.
    covariance : (P, P) of its parameters in the order of `ParameterLayout`; 0 for fixed ones and
        along gauge freedoms.
    observations : those that agree. residual_px : (N, 2) residuals of each pair.
    scale : factor on the standard errors of each pair, its systematic ratio [-].
    freedoms : (F, P) gauge freedoms, of unit length in scaled parameters.
    sphere_systematic_ratio : systematic ratio on an exact sphere [-].
    main : the camera that light is measured with: the one that sees most of the projectors' pixels.
    given : projectors whose directions are given, not solved, with their standard error [arcmin].
    """

    rig: RigGeometry
    covariance: Array
    observations: Mapping[Pair, Observations]
    residual_px: Mapping[Pair, Array]
    scale: Mapping[Pair, float]
    freedoms: Array
    sphere_systematic_ratio: float
    main: str
    given: Mapping[str, float] = field(default_factory=dict)

    @property
    def camera(self) -> CameraModel:
        """The main camera, with its pose."""
        return self.rig.cameras[self.main]

    @property
    def gauge_freedoms(self) -> int:
        """How many of the freedoms move a camera: the rig may turn, or grow, and nothing shows it.

        The others are within one projector, whose light falls on a plane: pose and lens are then not known
        apart, and places do not depend on it.
        """
        cameras = ParameterLayout.of(self.rig).cameras.values()
        size = np.linalg.norm(self.freedoms, axis=1, keepdims=True)
        moves = [self.freedoms[:, columns] / size for columns in cameras]
        return int((np.linalg.svd(np.concatenate(moves, axis=1), compute_uv=False) > MOVES).sum())

    @property
    def projectors(self) -> Mapping[str, ProjectorModel]:
        """The projectors by name."""
        return self.rig.projectors


def solve_geometry(problem: RigProblem) -> GeometrySolution:
    """Solve a rig.

    The screen's harmonics are solved for if an exact sphere does not explain what was seen. A mesh keeps its
    shape but for walls that are not where they were drawn; the first camera gets its start from four or more
    fiducials.

    Raises
    ------
    InputError
        If an observation is not finite.
    CalibrationError
        If there is no solution, or fiducials contradict each other.
    """
    _check_finite(problem.observations)
    place = _in_room if isinstance(problem.shape, MeshShape) else _on_sphere
    problem, rig = place(problem)
    observations, few = problem.observations, _thinned(problem.observations)
    on_sphere, used = mean_ratio(rig, few), observations
    rig = _with_harmonics(problem, few, rig) if problem.shape.is_sphere else rig
    if not rig.shape.is_sphere:
        used = {pair: some.thinned(MOST_NOT_SPHERE) for pair, some in used.items()}
    rig, last = _last_fit(problem, agreeing(rig, used), rig)
    check_fiducials(rig, problem.fiducials, problem.distances, rough=on_sphere > MAX_SPHERE_RATIO)
    seen = agreeing(rig, observations, GROSS_SIGMAS)
    covariance, freedoms, scales = last.uncertainty(rig)
    errors = {pair: residuals(rig, pair, some) for pair, some in seen.items()}
    rig = with_covariances(rig, covariance)
    main = by_most_seen(rig.cameras, seen)[0]
    return GeometrySolution(rig, covariance, seen, errors, scales, freedoms, on_sphere, main)


def _thinned(seen: Mapping[Pair, Observations]) -> dict[Pair, Observations]:
    """A few observations of each pair, for the first fits."""
    return {pair: some.thinned(FEW) for pair, some in seen.items()}


def _last_fit(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> tuple[RigGeometry, Adjustment]:
    """The last fit, in which panels have square pixels unless the observations contradict that."""
    prior = prior_sigmas(problem, rig)
    free = Adjustment(problem, seen, prior)
    rig = free.solve(rig, robust=False)
    last = Adjustment(problem, seen, prior, square_panels(rig, free.uncertainty(rig)[0]))
    return last.solve(rig, robust=False), last


def square_panels(rig: RigGeometry, covariance: Array) -> list[str]:
    """Projectors whose pixels may be square together, by a fit that does not tie them.

    One camera sees differences between panels much better than what all have in common, so they are
    judged by their joint covariance: the one that contradicts most is left out, until the rest agrees.
    """
    names = list(rig.projectors)
    error, slopes = square_rows(rig, names)
    variance = slopes @ covariance @ slopes.T + np.eye(len(names))
    while names:
        inverse = np.linalg.inv(variance)
        score = inverse @ error
        if error @ score < NOT_SQUARE**2:
            break
        worst = int(np.argmax(score**2 / np.diag(inverse)))  # its chi squared goes with it
        names.pop(worst)
        error = np.delete(error, worst)
        variance = np.delete(np.delete(variance, worst, 0), worst, 1)
    return names


def _with_harmonics(
    problem: RigProblem, few: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """The rig with as many harmonics of the screen as reduce the systematic ratio."""
    sphere = rig
    for degree in DEGREES:
        ratio = mean_ratio(rig, few)
        if ratio < MAX_SPHERE_RATIO or degree > problem.most_degree:
            break
        coefficients = np.zeros(shape_coefficient_count(degree))
        coefficients[: rig.shape.harmonic_coefficients.size] = rig.shape.harmonic_coefficients
        shape = replace(rig.shape, harmonic_coefficients=coefficients, degree=degree)
        try:
            trial = fitted(problem, few, RigGeometry(shape, rig.cameras, rig.projectors))
        except DidNotConverge:
            break
        if mean_ratio(trial, few) > EXPLAINS * ratio:
            break
        rig = trial
    if len(rig.cameras) == 1 and mean_ratio(rig, few) > EXPLAINS_ALONE * mean_ratio(sphere, few):
        return sphere
    return rig


def _check_finite(observations: Mapping[Pair, Observations]) -> None:
    for (camera, projector), some in observations.items():
        lost = ~np.isfinite(np.c_[some.camera_px, some.projector_px, some.sigma_px]).all(axis=1)
        if lost.any():
            raise InputError(
                f"observations: {lost.sum()} of {lost.size} that {camera} has of {projector} are NaN or "
                "infinite. Leave out pixels that were not seen."
            )


def with_covariances(rig: RigGeometry, covariance: Array) -> RigGeometry:
    """The rig, whose projectors have their blocks of a covariance (P, P)."""
    blocks = ParameterLayout.of(rig).projectors
    projectors = {
        name: replace(p, covariance=covariance[blocks[name], blocks[name]])
        for name, p in rig.projectors.items()
    }
    return RigGeometry(rig.shape, rig.cameras, projectors)


def _on_sphere(problem: RigProblem) -> tuple[RigProblem, RigGeometry]:
    """All devices in the dome frame, on an exact sphere."""
    few = _thinned(problem.observations)
    free = replace(problem, fiducials=(), distances=())
    rig = fitted(free, few, _started(free, few))
    _check_roughly(problem, few, rig)
    return problem, fitted(problem, few, rotated_to_fiducials(rig, problem.fiducials))


def _in_room(problem: RigProblem) -> tuple[RigProblem, RigGeometry]:
    """All devices in a room, and its problem with errors of patches and marks that hold in this room.

    Walls may be off, and with them marks. Without marks, or walls that may move, lenses would bend until the
    pictures fit.
    """
    shape, few = problem.shape, _thinned(problem.observations)
    assert isinstance(shape, MeshShape)
    near = replace(problem, fiducials=loosened(shape, problem.fiducials, WALLS_OFF_M))
    rig = robustly(near, few, _started_on_mesh(near, few))
    rig = robustly(near, few, replace(rig, shape=shape.with_free_walls()))
    problem = replace(problem, observations=widened_at_creases(rig, problem.observations))
    few = _thinned(problem.observations)
    rig = robustly(near, few, rig)
    check_fiducials(rig, near.fiducials, near.distances, rough=True)
    return with_walls(problem, few, rig)


def _check_roughly(problem: RigProblem, few: Mapping[Pair, Observations], rig: RigGeometry) -> None:
    """Refuse marks that contradict a rig solved without them, and also one with other lenses.

    Without marks a lens with a prior may be degrees off. Then marks have to fit the rig with the lenses
    of venue.toml, with free ones, or with those that the marks themselves help to solve; if they bend
    the lens against the observations, they are wrong.
    """
    marks = problem.fiducials, problem.distances
    try:
        check_fiducials(rig, *marks, rough=True, size_known=problem.radius_known)
    except CalibrationError:
        lenses = {n: c.lens for n, c in problem.cameras.items() if problem.intrinsics[n] != "fixed"}
        cameras = {n: replace(c, lens=lenses.get(n, c.lens)) for n, c in rig.cameras.items()}
        given = replace(rig, cameras=cameras)
        modes: tuple[Intrinsics, ...] = ("fixed", "solve") if lenses else ()
        unmarked = replace(problem, fiducials=(), distances=())
        for mode in modes:
            intrinsics = {**problem.intrinsics, **dict.fromkeys(lenses, mode)}
            if _fits_marks(replace(unmarked, intrinsics=intrinsics), few, given, marks):
                return
        turned, worst = rotated_to_fiducials(given, problem.fiducials), BENT * mean_ratio(rig, few)
        if not (lenses and _fits_marks(problem, few, turned, marks, worst)):
            raise


def _fits_marks(
    problem: RigProblem,
    few: Mapping[Pair, Observations],
    start: RigGeometry,
    marks: tuple[Sequence[Fiducial], Sequence[Distance]],
    most: float = np.inf,
) -> bool:
    """Whether a rig solved from a start agrees with marks, with a systematic ratio of at most `most`."""
    try:
        rig = fitted(problem, few, start)
        check_fiducials(rig, *marks, rough=True, size_known=problem.radius_known)
    except CalibrationError:
        return False
    return mean_ratio(rig, few) <= most


def _started_on_mesh(problem: RigProblem, few: Mapping[Pair, Observations]) -> RigGeometry:
    """All devices near their poses on a mesh, from the fiducials that one camera sees."""
    camera = resect_camera(problem.cameras, problem.shape, problem.fiducials)
    alone = RigGeometry(problem.shape, {camera.name: camera}, {})
    return _with_others(problem, few, resect_projectors(alone, problem.projectors, few))


def _started(problem: RigProblem, seen: Mapping[Pair, Observations]) -> RigGeometry:
    """All devices near their poses, in the axes of the camera with the most observations."""
    first = by_most_seen(problem.cameras, seen)[0]
    rigs = initial_rigs(problem.cameras[first], problem.shape, problem.projectors, seen)
    for most in TRIES:
        rigs = _best_first(problem, seen, rigs[:most])
        if mean_ratio(rigs[0], _visible(rigs[0], seen)) < MAX_SPHERE_RATIO:
            break
        # resect projectors that started too far off from the better position of the camera
        rigs = [resect_projectors(rig, problem.projectors, seen) for rig in rigs]
    return _with_others(problem, seen, rigs[0])


def _with_others(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """The rig with the other cameras, added one by one and fitted each time."""
    rig = _roughly(problem, seen, rig)
    for name in by_most_seen(problem.cameras, seen):
        if name not in rig.cameras:
            rig = add_camera(rig, problem.cameras[name], problem.projectors, seen)
            rig = _roughly(problem, seen, rig)
    check_projectors_placed(rig, problem.projectors)
    return rig


def by_most_seen(cameras: Iterable[str], seen: Mapping[Pair, Observations]) -> list[str]:
    """Cameras, first the one that sees most of the projectors' pixels."""
    pixels = {pair: len(some.sigma_px) * some.patch_px**2 for pair, some in seen.items()}
    total = {
        name: sum(n for (camera, _), n in pixels.items() if camera == name) for name in cameras
    }
    return sorted(total, key=lambda name: -total[name])


def _best_first(
    problem: RigProblem, seen: Mapping[Pair, Observations], starts: Sequence[RigGeometry]
) -> list[RigGeometry]:
    """Rigs after a few robust steps, best first; the first that fits ends the search."""
    tried: list[tuple[float, RigGeometry]] = []
    for start in starts:
        rig = _roughly(problem, seen, start)
        tried.append((mean_ratio(rig, _visible(rig, seen)), rig))
        if tried[-1][0] < MAX_SPHERE_RATIO:
            return [rig]
    return [rig for _, rig in sorted(tried, key=lambda each: each[0])]


def _roughly(
    problem: RigProblem, seen: Mapping[Pair, Observations], rig: RigGeometry
) -> RigGeometry:
    """A few robust steps on the devices that the rig has so far, by the marks that these see."""
    marks = [f for f in problem.fiducials if f.device in rig.cameras or f.device in rig.projectors]
    problem = replace(problem, fiducials=marks, distances=())
    few = {pair: some.thinned(ROUGH) for pair, some in _visible(rig, seen).items()}
    return Adjustment(problem, few, prior_sigmas(problem, rig)).solve(rig, robust=True)


def _visible(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> dict[Pair, Observations]:
    return {(c, p): o for (c, p), o in seen.items() if c in rig.cameras and p in rig.projectors}
