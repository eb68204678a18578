"""Levenberg-Marquardt for rigs: observations, marks and what was known before, weighed together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from procam.errors import DidNotConverge
from procam.estimate.geometry.fiducials import mark_errors, mark_rows
from procam.estimate.geometry.model import (
    POSE,
    PUPIL,
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    normal_equations,
    residuals,
    shape_derivatives,
)
from procam.estimate.geometry.start import ProjectorPrior
from procam.kernels import ShapeDerivatives
from procam.maths.geometry.lenses import unproject
from procam.maths.geometry.ray_to_screen import RoundShape
from procam.model.optics import CameraModel, Distance, Fiducial

Array = NDArray[np.float64]
Intrinsics = Literal["fixed", "prior", "solve"]
ROUNDS, ROBUST_ROUNDS = 100, 8  # lenses solved by one camera creep along what it hardly tells
CELLS = 10  # along both edges of a panel
PANELS = 100  # that a dome is made of
CLIPPED = 50.0  # standard errors, so that a misread patch does not speak for its cell
CAUCHY = 2.5  # standard errors from which on an observation counts less
SETTLED = 0.01  # of chi squared: a step that gains less moves nothing by a tenth of its error
EASING = {True: (1e-3, 10.0), False: (1e-6, 100.0)}  # first damping and its fall, robust or not
UNDAMPED = 1e-9  # of the normal matrix' diagonal: with more, a step goes nowhere along what is weak
LEAST_DAMPING = 1e-11  # keeps freedoms that nothing fixes from being singular
LENS_PRIOR = {  # focal, centre [shares of the size]; distortion, one by one [-]
    "fixed": None,
    "prior": (0.005, 0.005, 0.02),
    "solve": (0.2, 0.05, 0.2),
}
PUPIL_PRIOR_M = 0.005
BUMP_PRIOR = 3e-4  # of the radius, for each: domes are built to a centimetre
BROWN_PRIOR = (0.3, 0.3, 0.02, 0.02, 0.0)  # k1 k2 p1 p2 k3 of a projector; five would be too many
FISHEYE_PRIOR = (0.2, 0.1, 0.05, 0.02)


@dataclass(frozen=True, slots=True)
class RigProblem:
    """What is known of a rig before it is solved.

    Attributes
    ----------
    shape : the screen to start from. radius_known : whether its radius was measured.
    cameras : not placed. intrinsics : how far each camera's lens is trusted.
    hung : the projectors. observations : what cameras see of them, by (camera, projector).
    fiducials, distances : what fixes the rig in space.
    most_degree : up to which bumps of the screen are solved for; 0 insists on an exact sphere.
    """

    shape: RoundShape
    cameras: Mapping[str, CameraModel]
    hung: Mapping[str, ProjectorPrior]
    observations: Mapping[Pair, Observations]
    intrinsics: Mapping[str, Intrinsics]
    fiducials: Sequence[Fiducial] = ()
    distances: Sequence[Distance] = ()
    radius_known: bool = True
    most_degree: int = 8


def scores(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None = None,
    relief: ShapeDerivatives | None = None,
) -> Array:
    """Length (N,) of the residuals in their standard errors; infinite where there is no answer."""
    error = np.linalg.norm(residuals(rig, pair, seen, ray, relief), axis=1) / seen.sigma_px
    return np.nan_to_num(error, nan=np.inf)


def systematic_ratio(
    rig: RigGeometry,
    pair: Pair,
    seen: Observations,
    ray: Array | None = None,
    relief: ShapeDerivatives | None = None,
) -> float:
    """By how much means over cells of the panel exceed their standard errors; never less than 1.

    Where the model is right, neighbours err independently and means over many are small. A screen
    that is no sphere leaves smooth fields, of which a thousand observations tell no more than one.
    """
    size = np.array(rig.projectors[pair[1]].size)
    error = residuals(rig, pair, seen, ray, relief)
    score = np.clip(error / seen.sigma_px[:, None], -CLIPPED, CLIPPED)
    cell = np.clip(seen.projector_px / size * CELLS, 0, CELLS - 1).astype(int) @ [1, CELLS]
    number = np.maximum(np.bincount(cell, minlength=CELLS**2), 1)
    sums = [np.bincount(cell, np.nan_to_num(s), CELLS**2) for s in score.T]
    share = number >= 0.3 * np.median(number[number > 1])
    return max(1.0, float(np.sqrt(np.mean(np.square(sums)[:, share] / number[share]))))


def robust_sigma(score: Array) -> float:
    """Standard deviation per axis of a crowd of residual lengths, blind to outliers."""
    return float(np.median(score)) / 1.1774  # the median of a Rayleigh distribution


def prior_of(problem: RigProblem, rig: RigGeometry) -> Array:
    """Standard deviations (P,) of the parameters before anything is seen; 0 for fixed ones."""
    layout = ParameterLayout.of(rig)
    sigma = np.full(layout.count, np.inf)
    sigma[layout.screen] = np.r_[
        0.0 if problem.radius_known else np.inf,
        np.full(rig.shape.bumps.size, BUMP_PRIOR if rig.shape.degree else 0.0),
    ]
    for name, camera in rig.cameras.items():
        block = sigma[layout.cameras[name]]
        trust = LENS_PRIOR[problem.intrinsics[name]]
        if trust is None:
            block[POSE:] = 0.0
            continue
        focal, centre, bend = trust
        block[POSE : POSE + 2] = focal * camera.lens.focal
        block[POSE + 2 : POSE + 4] = centre * max(camera.size)
        block[POSE + 4 : -PUPIL] = bend / 4.0 ** np.arange(camera.lens.distortion.size)
        block[-PUPIL:] = PUPIL_PRIOR_M
    for name, projector in rig.projectors.items():
        bends = BROWN_PRIOR if projector.lens.kind == "brown" else FISHEYE_PRIOR
        sigma[layout.projectors[name]][POSE + 4 :] = bends
    return sigma


class Adjustment:
    """Levenberg-Marquardt on a set of observations, marks and priors."""

    def __init__(
        self, problem: RigProblem, seen: Mapping[Pair, Observations], prior: Array
    ) -> None:
        self.problem, self.seen, self.prior = problem, seen, prior
        self.free = prior > 0
        fixed = {n for n, how in problem.intrinsics.items() if how == "fixed"}
        self.rays = {
            pair: unproject(some.camera_px, problem.cameras[pair[0]].lens)
            for pair, some in seen.items()
            if pair[0] in fixed
        }

    def solve(self, rig: RigGeometry, robust: bool) -> RigGeometry:
        """Iterate until a step gains nothing; `robust` weighs what is far off less (Cauchy)."""
        moved, (damping, easing) = np.zeros(len(self.prior)), EASING[robust]
        self._look(rig)
        scale = self._spreads(rig) if robust else self._scales(rig)
        for _ in range(ROBUST_ROUNDS if robust else ROUNDS):
            if robust:  # never wider again: that would be to give a projector up
                now = self._spreads(rig)
                scale = {pair: min(scale[pair], now[pair]) for pair in scale}
            matrix, gradient = self._equations(rig, self._weights(rig, scale, robust), moved)
            cost = self._cost(rig, scale, robust, moved)
            while True:
                step = self._step(matrix, gradient, damping)
                ahead = rig.moved(step)
                gain = cost - self._cost(ahead, scale, robust, moved + step)
                if gain >= -1e-9 * max(cost, 1.0) or damping > 1e8:
                    break
                damping = max(10 * damping, 1e-6)
            rig, moved, damping = ahead, moved + step, damping / easing
            self._look(rig)
            if gain < SETTLED and damping < UNDAMPED:
                return rig
        if robust:
            return rig  # the next round begins here, with other weights
        raise DidNotConverge(
            f"geometry: got no minimum in {ROUNDS} steps, expected one in about 10; are all cameras "
            "and projectors what venue.toml says, and did none move?"
        )

    def certainty(self, rig: RigGeometry) -> tuple[Array, Array, dict[Pair, float]]:
        """Covariance (P, P), freedoms (F, P) that nothing fixes, and the residuals' scales."""
        self._look(rig)
        scales = self._scales(rig)
        weight = self._weights(rig, scales, robust=False)
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

    def _look(self, rig: RigGeometry) -> None:
        """Evaluate the screen's harmonics where the rays of a rig meet it; near by they go on."""
        self.reliefs: dict[Pair, ShapeDerivatives | None] = {}
        for pair, some in self.seen.items():
            ray = self.rays.get(pair)
            if ray is None and not rig.shape.exact:
                ray = unproject(some.camera_px, rig.cameras[pair[0]].lens)
            self.reliefs[pair] = None if ray is None else shape_derivatives(rig, pair[0], ray)

    def _spreads(self, rig: RigGeometry) -> dict[Pair, float]:
        """Middle residuals in standard errors, per pair; never less than 1."""
        return {p: max(robust_sigma(self._scores(rig, p)), 1.0) for p in self.seen}

    def _scores(self, rig: RigGeometry, pair: Pair) -> Array:
        return scores(rig, pair, self.seen[pair], self.rays.get(pair), self.reliefs[pair])

    def _scales(self, rig: RigGeometry) -> dict[Pair, float]:
        """By how much residuals exceed their standard errors, per pair; never less than 1."""
        scales = {
            p: systematic_ratio(rig, p, o, self.rays.get(p), self.reliefs[p])
            for p, o in self.seen.items()
        }
        if not rig.shape.degree:
            return scales
        # a panel that sticks out is one fact, however many cells and devices look at it
        often = max(1.0, float(np.sqrt(len(scales) * CELLS**2 / PANELS)))
        return {pair: scale * often for pair, scale in scales.items()}

    def _weights(
        self, rig: RigGeometry, scale: Mapping[Pair, float], robust: bool
    ) -> dict[Pair, Array]:
        """1/variance (N,) per pair, times Cauchy's weight if robust."""
        weight = {}
        for pair, some in self.seen.items():
            weight[pair] = 1 / (some.sigma_px * scale[pair]) ** 2
            if robust:
                score = self._scores(rig, pair) / (CAUCHY * scale[pair])
                weight[pair] = weight[pair] / (1 + score**2)
        return weight

    def _cost(
        self, rig: RigGeometry, scale: Mapping[Pair, float], robust: bool, moved: Array
    ) -> float:
        total = 0.0
        for pair, some in self.seen.items():
            error = residuals(rig, pair, some, self.rays.get(pair), self.reliefs[pair])
            square = np.sum(np.nan_to_num(error, nan=1e4) ** 2, axis=1)
            square /= (some.sigma_px * scale[pair]) ** 2
            total += float(np.sum(CAUCHY**2 * np.log1p(square / CAUCHY**2) if robust else square))
        error = mark_errors(rig, self.problem.fiducials, self.problem.distances)
        error = np.nan_to_num(error, nan=1e6)
        return total + float(error @ error + self._trust() @ moved**2)

    def _equations(
        self, rig: RigGeometry, weight: Mapping[Pair, Array], moved: Array
    ) -> tuple[Array, Array]:
        matrix, gradient = normal_equations(
            rig, self.seen, weight, self.free, self.rays, self.reliefs
        )
        error, slopes = mark_rows(rig, self.problem.fiducials, self.problem.distances)
        slopes = slopes * self.free
        trust = self._trust()
        matrix += slopes.T @ slopes + np.diag(trust)
        return matrix, gradient + slopes.T @ error + trust * moved

    def _trust(self) -> Array:
        """1/variance (P,) of the priors; 0 where there is none or the parameter is fixed."""
        known = self.free & np.isfinite(self.prior)
        return np.where(known, 1 / np.where(known, self.prior, 1.0) ** 2, 0.0)

    def _step(self, matrix: Array, gradient: Array, damping: float) -> Array:
        square, slope = matrix[np.ix_(self.free, self.free)], gradient[self.free]
        root = np.sqrt(np.maximum(np.diag(square), 1e-30))
        scaled = square / np.outer(root, root)
        scaled[np.diag_indices_from(scaled)] += max(damping, LEAST_DAMPING)
        step = np.zeros(len(gradient))
        # NumPy's own solver stalls for a hundred milliseconds where a core is busy
        step[self.free] = -cho_solve(cho_factor(scaled), slope / root) / root
        return step
