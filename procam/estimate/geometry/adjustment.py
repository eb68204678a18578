"""Levenberg-Marquardt for rigs (docs/theory/geometry.md (G2)).

The cost is the sum of squares of three kinds of residuals, each over its standard error:
observations, fiducials and distances, and the parameters' departures from their priors. A robust
phase with Cauchy weights (Triggs et al. 2000, doi:10.1007/3-540-44480-7_21) finds the observations
that agree; a plain phase solves for them. Residuals that neighbouring observations share are
estimated as a systematic ratio per pair of camera and projector, which scales their standard errors. The
module is longer than 300 lines because residuals, priors and weights share one cost.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from procam.arrays import Array
from procam.errors import DidNotConverge
from procam.estimate.geometry.fiducials import fiducial_residuals, fiducial_rows
from procam.estimate.geometry.model import (
    POSE,
    PUPIL,
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    normal_equations,
    residuals,
    screen_derivatives,
)
from procam.estimate.geometry.start import ProjectorPrior
from procam.kernels import ShapeDerivatives
from procam.maths.geometry.lenses import lens_parameters, unproject
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.maths.mesh.shape import MeshShape
from procam.maths.statistics import robust_sigma_2d
from procam.model.optics import CameraModel, Distance, Fiducial

Intrinsics = Literal["fixed", "prior", "solve"]
ROUNDS, ROBUST_ROUNDS = 100, 8  # lenses solved from one camera converge slowly
CELLS = 10  # along each edge of a projector's panel, for the systematic ratio: as many as a dome has panels
COARSER_CELLS = (5, 3)  # in which a misfit that is smooth over the panel stands out
CLIPPED = 50.0  # standard errors: limit of a residual, so that no misread patch dominates its cell
CAUCHY = 2.5  # standard errors: scale of the robust loss
CONVERGED = 0.01  # of chi squared: a smaller gain moves no parameter by a tenth of its sigma
DAMPING = {True: (1e-3, 10.0), False: (1e-6, 100.0)}  # initial, and divisor per step; robust or not
STALLED = 6  # rounds without a lower cost
UNDAMPED = 1e-9  # of the diagonal: with more damping, weakly determined parameters do not move
LEAST_DAMPING = 1e-11  # keeps the matrix regular along gauge freedoms
LENS_PRIOR = {  # sigmas: focal length [share], centre [share of the size], first distortion [-]
    "fixed": None,
    "prior": (0.005, 0.005, 0.02),
    "solve": (0.2, 0.05, 0.2),
}
PUPIL_PRIOR_M = 0.005
BROWN_PRIOR = (0.3, 0.3, 0.02, 0.02, 5e-4)  # k1 k2 p1 p2 k3 of a projector
FISHEYE_PRIOR = (0.2, 0.1, 0.05, 0.02)
SQUARE = 5e-5  # share by which the two focal lengths of square pixels may differ


@dataclass(frozen=True, slots=True)
class RigProblem:
    """What is known of a rig before it is solved.

    Attributes
    ----------
    shape : the screen to start from.
    cameras : without poses.
    projectors : sizes and kinds of lens.
    observations : by (camera, projector).
    intrinsics : whether each camera's lens is fixed, has a prior, or is solved for.
    fiducials, distances : what fixes the rig in space.
    radius_known : whether the screen's radius was measured.
    most_degree : highest degree of the screen's harmonics that is tried; 0 for an exact sphere.
    """

    shape: RoundShape
    cameras: Mapping[str, CameraModel]
    projectors: Mapping[str, ProjectorPrior]
    observations: Mapping[Pair, Observations]
    intrinsics: Mapping[str, Intrinsics]
    fiducials: Sequence[Fiducial] = ()
    distances: Sequence[Distance] = ()
    radius_known: bool = True
    most_degree: int = 8


def normalised_residuals(error: Array, seen: Observations) -> Array:
    """Lengths (N,) of residuals (N, 2) over their standard errors; infinite where undefined."""
    return np.nan_to_num(np.linalg.norm(error, axis=1) / seen.sigma_px, nan=np.inf)


def systematic_ratio(
    error: Array, seen: Observations, size: tuple[int, int], cells: int = CELLS
) -> float:
    """Rms of residuals (N, 2) averaged over cells, over its value for independent errors; at least 1.

    Where the model is right, the errors of neighbours are independent and the ratio is 1. A screen
    that is not a sphere leaves smooth residuals, of which a thousand observations determine no more
    than one does. `size` is that of the panel [px], `cells` the number along each of its edges.
    """
    score = np.clip(error / seen.sigma_px[:, None], -CLIPPED, CLIPPED)
    cell = np.clip(seen.projector_px / np.array(size) * cells, 0, cells - 1).astype(int) @ [
        1,
        cells,
    ]
    number = np.maximum(np.bincount(cell, minlength=cells**2), 1)
    sums = [np.bincount(cell, np.nan_to_num(s), cells**2) for s in score.T]
    share = number >= 0.3 * np.median(number[number > 1])
    return max(1.0, float(np.sqrt(np.mean(np.square(sums)[:, share] / number[share]))))


def prior_sigmas(problem: RigProblem, rig: RigGeometry) -> Array:
    """Prior standard deviations (P,) of the parameters; 0 for fixed ones, infinite for free ones."""
    layout = ParameterLayout.of(rig)
    sigma = np.full(layout.count, np.inf)
    radius = 0.0 if problem.radius_known else np.inf
    sigma[layout.screen] = np.r_[radius, rig.shape.coefficient_sigmas]
    for name, camera in rig.cameras.items():
        block = sigma[layout.cameras[name]]
        lens_prior = LENS_PRIOR[problem.intrinsics[name]]
        if lens_prior is None:
            block[POSE:] = 0.0
            continue
        focal, centre, distortion = lens_prior
        block[POSE : POSE + 2] = focal * problem.cameras[name].lens.focal
        block[POSE + 2 : POSE + 4] = centre * max(camera.size)
        block[POSE + 4 : -PUPIL] = distortion / 4.0 ** np.arange(camera.lens.distortion.size)
        block[-PUPIL:] = PUPIL_PRIOR_M
    for name, projector in rig.projectors.items():
        distortions = BROWN_PRIOR if projector.lens.kind == "brown" else FISHEYE_PRIOR
        sigma[layout.projectors[name]][POSE + 4 :] = distortions
    return sigma


def prior_departures(problem: RigProblem, rig: RigGeometry) -> Array:
    """How far (P,) the parameters of a rig with priors are from what the problem says; 0 for the others."""
    layout = ParameterLayout.of(rig)
    away = np.zeros(layout.count)
    away[layout.screen][1:] = rig.shape.harmonic_coefficients
    for name, camera in rig.cameras.items():
        known = problem.cameras[name]
        given, found = (np.r_[lens_parameters(c.lens), c.pupil] for c in (known, camera))
        away[layout.cameras[name]][POSE:] = found - given
    for name, projector in rig.projectors.items():
        away[layout.projectors[name]][POSE + 4 :] = projector.lens.distortion
    return away


def square_rows(rig: RigGeometry, names: Iterable[str]) -> tuple[Array, Array]:
    """Differences (n,) of projectors' two focal lengths over their tolerance, and slopes (n, P)."""
    layout, error, slopes = ParameterLayout.of(rig), [], []
    for name in names:
        focal = rig.projectors[name].lens.focal
        slope, first = np.zeros(layout.count), layout.projectors[name].start + POSE
        slope[first : first + 2] = np.array([1.0, -1.0]) / (SQUARE * focal.mean())
        error.append(slope[first : first + 2] @ focal)
        slopes.append(slope)
    return np.array(error), np.array(slopes).reshape(-1, layout.count)


def descent(
    step_at: Callable[[float], Array], cost: Callable[[Array], float], damping: float
) -> tuple[Array, float, float]:
    """A step (P,) that lowers the cost if one does, by how much, and the damping that it took.

    Where undamped steps overshoot, in a bent valley, damped ones creep; they are doubled as long as
    the cost falls.
    """
    step, first = step_at(damping), damping
    start = cost(np.zeros_like(step))
    while not (gain := start - cost(step)) >= -1e-9 * max(start, 1.0) and damping <= 1e8:
        damping = max(10 * damping, 1e-6)
        step = step_at(damping)
    while damping > first and (more := start - cost(2 * step)) > gain:
        step, gain = 2 * step, more
    return step, gain, damping


@dataclass(slots=True)
class _Best:
    """The rig of the lowest cost so far, and for how many rounds there was none lower."""

    rig: RigGeometry
    cost: float = np.inf
    rounds: int = 0

    def stalls(self, rig: RigGeometry, cost: float) -> bool:
        """Whether rigs only go round about a minimum, where rays that cross edges of walls make kinks."""
        self.rounds += 1
        if cost < self.cost - CONVERGED:
            self.rig, self.cost, self.rounds = rig, cost, 0
        return self.rounds >= STALLED


class Adjustment:
    """Levenberg-Marquardt on a set of observations, fiducials and priors.

    The projectors named in `square` have square pixels.
    """

    def __init__(
        self,
        problem: RigProblem,
        seen: Mapping[Pair, Observations],
        prior: Array,
        square: Iterable[str] = (),
    ) -> None:
        self.problem, self.seen, self.prior = problem, seen, prior
        self.square = tuple(square)
        self.free = prior > 0
        fixed = {name for name, mode in problem.intrinsics.items() if mode == "fixed"}
        self.rays = {
            pair: unproject(some.camera_px, problem.cameras[pair[0]].lens)
            for pair, some in seen.items()
            if pair[0] in fixed
        }

    def solve(self, rig: RigGeometry, robust: bool) -> RigGeometry:
        """Iterate to convergence; with `robust`, large residuals get Cauchy's lower weights.

        Raises
        ------
        DidNotConverge
            If the plain phase finds no minimum.
        """
        # from what venue.toml says, not from where an earlier stage ended
        moved, (damping, easing) = prior_departures(self.problem, rig), DAMPING[robust]
        self._update_derivatives(rig)
        scale, best = self._robust_sigmas(rig) if robust else self._scales(rig), _Best(rig)
        for _ in range(ROBUST_ROUNDS if robust else ROUNDS):
            if robust:  # a scale that grew again would discard a whole projector
                now = self._robust_sigmas(rig)
                scale = {pair: min(scale[pair], now[pair]) for pair in scale}
            matrix, gradient = self._equations(rig, self._weights(rig, scale, robust), moved)
            cost = partial(self._cost, rig, scale, robust, moved)
            step, gain, damping = descent(partial(self._step, matrix, gradient), cost, damping)
            rig, moved, damping = rig.moved(step), moved + step, damping / easing
            self._update_derivatives(rig)
            if gain < CONVERGED and damping < UNDAMPED:
                return rig
            if robust or not isinstance(rig.shape, MeshShape):
                continue
            if best.stalls(rig, self._cost(rig, scale, robust, moved, 0 * step)):
                return best.rig
        if robust:
            return rig  # a start for the next solve
        raise DidNotConverge(
            f"geometry: no minimum in {ROUNDS} steps, where 10 are usual. Check that all cameras (f of "
            "their lenses above all) and projectors are as venue.toml describes them and that none moved."
        )

    def uncertainty(self, rig: RigGeometry) -> tuple[Array, Array, dict[Pair, float]]:
        """Covariance (P, P), gauge freedoms (F, P), and the systematic ratio of each pair."""
        self._update_derivatives(rig)
        scales = self._scales(rig)
        counted = scales  # with harmonics they count a misfit that is shared already
        if not rig.shape.degree:
            coarser = {p: max(self._ratio(rig, p, n) for n in COARSER_CELLS) for p in scales}
            counted = _with_correlated_misfit(scales, coarser)
        weight = self._weights(rig, counted, robust=False)
        matrix, _ = self._equations(rig, weight, np.zeros(len(self.prior)))
        root = np.sqrt(np.diag(matrix)[self.free])
        values, vectors = np.linalg.eigh(
            matrix[np.ix_(self.free, self.free)] / np.outer(root, root)
        )
        loose = values < 1e-12 * values[-1]
        inverse = (vectors[:, ~loose] / values[~loose]) @ vectors[:, ~loose].T
        covariance = np.zeros_like(matrix)
        covariance[np.ix_(self.free, self.free)] = inverse / np.outer(root, root)
        freedoms = np.zeros((int(loose.sum()), len(self.prior)))
        freedoms[:, self.free] = (vectors[:, loose] / root[:, None]).T
        return covariance, freedoms, scales

    def _update_derivatives(self, rig: RigGeometry) -> None:
        """Evaluate the screen's harmonics for a rig; a step extrapolates them linearly."""
        self.derivatives: dict[Pair, ShapeDerivatives | None] = {}
        for pair, some in self.seen.items():
            ray = self.rays.get(pair)
            if ray is None and not rig.shape.is_sphere:
                ray = unproject(some.camera_px, rig.cameras[pair[0]].lens)
            self.derivatives[pair] = None if ray is None else screen_derivatives(rig, pair[0], ray)

    def _residuals(self, rig: RigGeometry, pair: Pair) -> Array:
        return residuals(rig, pair, self.seen[pair], self.rays.get(pair), self.derivatives[pair])

    def _robust_sigmas(self, rig: RigGeometry) -> dict[Pair, float]:
        """Robust sigma of each pair's residuals over their standard errors; at least 1."""
        return {
            p: max(robust_sigma_2d(normalised_residuals(self._residuals(rig, p), o)), 1.0)
            for p, o in self.seen.items()
        }

    def _scales(self, rig: RigGeometry) -> dict[Pair, float]:
        """Factors (at least 1) for the standard errors of each pair: their systematic ratios."""
        # devices that see the same misplaced panel of the dome are not independent
        repeats = float(np.sqrt(len(self.seen))) if rig.shape.degree else 1.0
        return {pair: repeats * self._ratio(rig, pair, CELLS) for pair in self.seen}

    def _ratio(self, rig: RigGeometry, pair: Pair, cells: int) -> float:
        size = rig.projectors[pair[1]].size
        return systematic_ratio(self._residuals(rig, pair), self.seen[pair], size, cells)

    def _weights(
        self, rig: RigGeometry, scale: Mapping[Pair, float], robust: bool
    ) -> dict[Pair, Array]:
        """1/variance (N,) per pair, times Cauchy's weight if robust."""
        weight = {}
        for pair, some in self.seen.items():
            weight[pair] = 1 / (some.sigma_px * scale[pair]) ** 2
            if robust:
                error = normalised_residuals(self._residuals(rig, pair), some)
                weight[pair] /= 1 + (error / (CAUCHY * scale[pair])) ** 2
        return weight

    def _cost(
        self,
        rig: RigGeometry,
        scale: Mapping[Pair, float],
        robust: bool,
        moved: Array,
        step: Array,
    ) -> float:
        """Sum of squared residuals after a step, or of their Cauchy loss, with fiducials and priors."""
        rig, moved = rig.moved(step), moved + step
        total = 0.0
        for pair, some in self.seen.items():
            error = self._residuals(rig, pair)
            square = np.sum(np.nan_to_num(error, nan=1e4) ** 2, axis=1)
            square /= (some.sigma_px * scale[pair]) ** 2
            total += float(np.sum(CAUCHY**2 * np.log1p(square / CAUCHY**2) if robust else square))
        error = fiducial_residuals(rig, self.problem.fiducials, self.problem.distances)
        error = np.r_[np.nan_to_num(error, nan=1e6), square_rows(rig, self.square)[0]]
        return total + float(error @ error + self._prior_weights() @ moved**2)

    def _equations(
        self, rig: RigGeometry, weight: Mapping[Pair, Array], moved: Array
    ) -> tuple[Array, Array]:
        """Normal matrix (P, P) and gradient (P,) of the cost."""
        matrix, gradient = normal_equations(
            rig, self.seen, weight, self.free, self.rays, self.derivatives
        )
        marks = fiducial_rows(rig, self.problem.fiducials, self.problem.distances)
        pixels = square_rows(rig, self.square)
        error, slopes = np.r_[marks[0], pixels[0]], np.r_[marks[1], pixels[1]] * self.free
        prior_weight = self._prior_weights()
        matrix += slopes.T @ slopes + np.diag(prior_weight)
        return matrix, gradient + slopes.T @ error + prior_weight * moved

    def _prior_weights(self) -> Array:
        """1/variance (P,) of the priors; 0 where there is none or the parameter is fixed."""
        known = self.free & np.isfinite(self.prior)
        return np.where(known, 1 / np.where(known, self.prior, 1.0) ** 2, 0.0)

    def _step(self, matrix: Array, gradient: Array, damping: float) -> Array:
        """The damped step (P,); the damping is relative to the diagonal."""
        square, slope = matrix[np.ix_(self.free, self.free)], gradient[self.free]
        root = np.sqrt(np.maximum(np.diag(square), 1e-30))
        scaled = square / np.outer(root, root)
        scaled[np.diag_indices_from(scaled)] += max(damping, LEAST_DAMPING)
        step = np.zeros(len(gradient))
        # np.linalg.solve stalls for 100 ms when another process occupies a core
        step[self.free] = -cho_solve(cho_factor(scaled), slope / root) / root
        return step


def _with_correlated_misfit(
    scales: Mapping[Pair, float], coarser: Mapping[Pair, float]
) -> dict[Pair, float]:
    """Factors for standard errors if what exceeds the noise is a misfit that pairs, or cells, share.

    A dome that is no sphere, or a lens of another kind, bends what every projector shows, so that more of
    them do not average it out. Nor do more cells if the misfit is smooth: `coarser` are the systematic
    ratios in larger cells, where it exceeds the noise by more.
    """
    excess = {p: max(len(scales) * (s**2 - 1), coarser[p] ** 2 - 1) for p, s in scales.items()}
    return {pair: float(np.sqrt(1 + more)) for pair, more in excess.items()}
