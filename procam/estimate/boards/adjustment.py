"""Lenses, device poses, board poses and a bent board from what devices see of board corners.

Levenberg-Marquardt with analytic derivatives. Each view's board pose meets only the parameters that
all views share, so the poses are eliminated first (Schur complement; Triggs et al. 2000,
doi:10.1007/3-540-44480-7_21) and a step costs time in proportion to the number of views.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from procam.maths.geometry.lens_derivatives import (
    lens_of_parameters,
    lens_parameters,
    project_with_derivatives,
)
from procam.maths.geometry.lenses import Lens, project
from procam.maths.geometry.pose import Pose, rotation_matrix

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
ITERATIONS = 200
CONVERGED = 1e-11
MOST_DAMPING = 1e12
SINGULAR = 1e-13
CAUCHY_SIGMAS = 3.0
RAYLEIGH_MEDIAN = 1.1774  # median length of a 2-D normal vector of unit sigma


@dataclass(frozen=True, slots=True)
class BoardRig:
    """What is solved for.

    Attributes
    ----------
    lenses : of each device.
    devices : pose of each device: x_device = pose.apply(x_first); the first one's is the identity.
    boards : pose of the board in each view: x_first = pose.apply(x_board).
    bend : (3,) sag of the board along its own z [m]: u^2, v^2 and u v, where (u, v) is the place
        from the middle of the board over its half diagonal.
    """

    lenses: tuple[Lens, ...]
    devices: tuple[Pose, ...]
    boards: tuple[Pose, ...]
    bend: Array


@dataclass(frozen=True)
class Corners:
    """Corners of all views, one behind the other.

    Attributes
    ----------
    points : (T, 3) on the flat board [m].
    pixels : (D, T, 2) where each device sees them [px].
    use : (D, T) which of these to fit.
    starts : (V + 1,) first corner of each view, and T.
    area : (2, 2) lowest and highest x, y of the board's corners [m].
    """

    points: Array
    pixels: Array
    use: Mask
    starts: NDArray[np.intp]
    area: Array

    @property
    def views(self) -> list[slice]:
        """Where the corners of each view are."""
        return [slice(a, b) for a, b in itertools.pairwise(self.starts)]

    @cached_property
    def view_of(self) -> NDArray[np.intp]:
        """Number of the view of each corner (T,)."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    @cached_property
    def sag(self) -> Array:
        """How the board's height changes with its bend (T, 3)."""
        low, high = self.area
        half = float(np.linalg.norm(high - low)) / 2
        u, v = ((self.points[:, :2] - (low + high) / 2) / half).T
        return np.stack([u * u, v * v, u * v], axis=1)

    def only(self, views: list[int]) -> "Corners":
        """The corners of some views; the others stay as places on the board that nobody sees."""
        use = np.zeros_like(self.use)
        for view in views:
            use[:, self.views[view]] = self.use[:, self.views[view]]
        return replace(self, use=use)


def gather_corners(
    points: Sequence[Array], pixels: Sequence[Array], area: Array | None = None
) -> Corners:
    """Corners of views: (N, 3) points [m] seen at (D, N, 2) pixels, NaN where a device sees none.

    `area` (2, 2) [m] is that of all points if not given.
    """
    every, where = np.concatenate(points), np.concatenate(pixels, axis=1)
    if area is None:
        area = np.stack([every[:, :2].min(axis=0), every[:, :2].max(axis=0)])
    starts = np.cumsum([0, *(len(p) for p in points)])
    seen = np.asarray(np.isfinite(where).all(axis=2), np.bool_)
    return Corners(every, where, seen, starts, area)


def residuals(corners: Corners, rig: BoardRig) -> Array:
    """Predicted minus seen pixel (D, T, 2) of every corner [px]; NaN where it cannot be seen."""
    placed = _placed(corners, rig)
    seen = [project(d.apply(placed), lens) for d, lens in zip(rig.devices, rig.lenses, strict=True)]
    return np.stack(seen) - corners.pixels


def spreads(corners: Corners, error: Array) -> Array:
    """Standard deviation (D,) of one coordinate of residuals (D, T, 2), unmoved by outliers [px]."""
    lengths = np.nan_to_num(np.linalg.norm(error, axis=2), nan=np.inf, posinf=np.inf)
    middle = [np.median(row[use]) for row, use in zip(lengths, corners.use, strict=True)]
    return np.maximum(np.array(middle) / RAYLEIGH_MEDIAN, 1e-9)


@dataclass(frozen=True)
class BoardAdjustment:
    """One least-squares problem.

    Attributes
    ----------
    corners : what was seen.
    free : per device, which of `lens_parameters` are solved for.
    sigma_px : (D,) standard deviation of one coordinate [px].
    bend : solve for the bend of the board.
    robust : weigh far corners down (Cauchy), for as long as gross ones are among them.
    """

    corners: Corners
    free: tuple[tuple[int, ...], ...]
    sigma_px: Array
    bend: bool = False
    robust: bool = False

    def solve(self, rig: BoardRig, iterations: int = ITERATIONS) -> tuple[BoardRig, bool]:
        """The nearest minimum, and whether it was reached."""
        damping, cost = 1e-4, self.cost(rig)
        for _ in range(iterations if np.isfinite(cost) else 0):
            equations = self._equations(rig)
            trial, new = rig, np.inf
            while not new <= cost:
                if damping > MOST_DAMPING:  # as low as rounding lets it be
                    return rig, True
                trial = self._stepped(rig, *equations.step(damping))
                new = self.cost(trial)
                damping *= 8
            gain = (cost - new) / max(cost, 1e-30)
            rig, cost, damping = trial, new, max(damping / 64, 1e-12)
            if gain < CONVERGED:
                return rig, True
        return rig, False

    def cost(self, rig: BoardRig) -> float:
        """Sum of the losses of all corners in use; infinite if one lies behind its device."""
        squared = self._squared(residuals(self.corners, rig))[self.corners.use]
        if not np.isfinite(squared).all():
            return np.inf
        limit = CAUCHY_SIGMAS**2
        return float(np.sum(limit * np.log1p(squared / limit) if self.robust else squared))

    def covariance(self, rig: BoardRig) -> Array:
        """Covariance (S, S) of the shared parameters, scaled by what the residuals really are.

        The order is: per device, its free lens parameters and, but for the first, turn [rad] and
        shift [m]; then the bend [m]. Infinite variances stand for what the views do not tell.
        """
        matrix = self._equations(rig).reduced(0.0)[0]
        known = self.shared + 6 * sum(self.corners.use[:, v].any() for v in self.corners.views)
        variance = self.cost(rig) / max(2 * int(self.corners.use.sum()) - known, 1)
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        value, vector = np.linalg.eigh(matrix / np.outer(scale, scale))
        value = np.where(value > SINGULAR, value, SINGULAR**2)
        return np.asarray(variance * (vector / value) @ vector.T / np.outer(scale, scale))

    @cached_property
    def shared(self) -> int:
        """How many parameters all views share."""
        return sum(map(len, self.free)) + 6 * (len(self.free) - 1) + 3 * self.bend

    def _squared(self, error: Array) -> Array:
        return np.asarray(np.sum(error**2, axis=2) / self.sigma_px[:, None] ** 2)

    def _equations(self, rig: BoardRig) -> "_Equations":
        views = len(rig.boards)
        sums = _Equations(
            np.zeros((self.shared, self.shared)),
            np.zeros((views, self.shared, 6)),
            np.zeros((views, 6, 6)),
            np.zeros(self.shared),
            np.zeros((views, 6)),
        )
        for device, use in enumerate(self.corners.use):
            index = np.flatnonzero(use)
            rows, own, error = self._rows(rig, device, index)
            ends = np.searchsorted(index, self.corners.starts)
            for view, (start, stop) in enumerate(itertools.pairwise(ends)):
                part = slice(2 * start, 2 * stop)
                sums.add(view, rows[part], own[part], error[part])
        return sums

    def _rows(
        self, rig: BoardRig, device: int, index: NDArray[np.intp]
    ) -> tuple[Array, Array, Array]:
        """Weighted derivatives (2n, S) and (2n, 6) and residuals (2n,) of one device's corners."""
        pose = rig.devices[device]
        board = self.corners.view_of[index]
        point = _placed(self.corners, rig)[index]
        ahead = pose.apply(point)
        pixel, by_ahead, by_lens = project_with_derivatives(ahead, rig.lenses[device])
        by_point = by_ahead @ pose.rotation
        rows = np.zeros((len(index), 2, self.shared))
        start = sum(map(len, self.free[:device])) + 6 * max(device - 1, 0)
        stop = start + len(self.free[device])
        rows[:, :, start:stop] = by_lens[:, :, list(self.free[device])]
        if device:
            rows[:, :, stop : stop + 6] = _by_step(ahead, by_ahead)
        if self.bend:
            normals = np.array([b.rotation[:, 2] for b in rig.boards])[board]
            lift = np.einsum("nij,nj->ni", by_point, normals)
            rows[:, :, -3:] = lift[:, :, None] * self.corners.sag[index, None, :]
        error = pixel - self.corners.pixels[device, index]
        squared = np.sum(error**2, axis=1) / self.sigma_px[device] ** 2
        weight = 1 / (1 + squared / CAUCHY_SIGMAS**2) if self.robust else np.ones(len(index))
        root = np.sqrt(weight)[:, None] / self.sigma_px[device]
        own = _by_step(point, by_point) * root[:, :, None]
        return (
            (rows * root[:, :, None]).reshape(2 * len(index), self.shared),
            own.reshape(2 * len(index), 6),
            (error * root).ravel(),
        )

    def _stepped(self, rig: BoardRig, shared: Array, own: Array) -> BoardRig:
        lenses, devices, start = [], [], 0
        for number, (lens, pose, free) in enumerate(
            zip(rig.lenses, rig.devices, self.free, strict=True)
        ):
            parameters = lens_parameters(lens)
            parameters[list(free)] += shared[start : start + len(free)]
            lenses.append(lens_of_parameters(lens, parameters))
            start += len(free)
            devices.append(moved(pose, shared[start : start + 6]) if number else pose)
            start += 6 if number else 0
        return BoardRig(
            tuple(lenses),
            tuple(devices),
            tuple(moved(b, x) for b, x in zip(rig.boards, own, strict=True)),
            rig.bend + shared[-3:] if self.bend else rig.bend,
        )


@dataclass(frozen=True, slots=True)
class _Equations:
    """Normal equations: shared (S, S), cross (V, S, 6), own (V, 6, 6), gradients (S,), (V, 6)."""

    matrix: Array
    cross: Array
    own: Array
    gradient: Array
    own_gradient: Array

    def add(self, view: int, rows: Array, own: Array, error: Array) -> None:
        """Rows (n, S) and (n, 6) of one view with residuals (n,)."""
        self.matrix[:] += rows.T @ rows
        self.cross[view] += rows.T @ own
        self.own[view] += own.T @ own
        self.gradient[:] += rows.T @ error
        self.own_gradient[view] += own.T @ error

    def reduced(self, damping: float) -> tuple[Array, Array, Array, Array]:
        """Matrix and gradient of the shared parameters alone; how the poses follow them."""
        diagonal = np.diagonal(self.own, axis1=1, axis2=2)
        # a view without corners stays where it is
        extra = np.where(diagonal > 0, damping * diagonal, 1.0)
        own = self.own + extra[:, :, None] * np.eye(6)
        follow: Array = np.linalg.solve(own, np.swapaxes(self.cross, 1, 2)).astype(float)
        still: Array = np.linalg.solve(own, self.own_gradient[:, :, None]).astype(float)
        matrix = self.matrix + damping * np.diag(np.diag(self.matrix))
        matrix = matrix - np.einsum("vsi,vit->st", self.cross, follow)
        gradient = self.gradient - np.einsum("vsi,vi->s", self.cross, still[:, :, 0])
        return matrix, gradient, follow, still[:, :, 0]

    def step(self, damping: float) -> tuple[Array, Array]:
        """Damped Gauss-Newton step of the shared parameters (S,) and of each pose (V, 6)."""
        matrix, gradient, follow, still = self.reduced(damping)
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        unit = matrix / np.outer(scale, scale)
        shared = -np.linalg.lstsq(unit, gradient / scale, rcond=1e-15)[0] / scale
        return shared, -still - follow @ shared


def moved(pose: Pose, x: Array) -> Pose:
    """`pose` turned by the rotation vector x[:3] [rad] about the device, and shifted by x[3:] [m]."""
    turn = rotation_matrix(x[:3])
    return Pose(turn @ pose.rotation, turn @ pose.translation + x[3:])


def _by_step(points: Array, by_point: Array) -> Array:
    """Derivatives (N, 2, 6) by the step of `moved`, from those by the point (N, 2, 3)."""
    return np.concatenate([np.cross(points[:, None, :], by_point), by_point], axis=2)


def _placed(corners: Corners, rig: BoardRig) -> Array:
    """Corners (T, 3) of the bent boards in the frame of the first device [m]."""
    bent = corners.points.copy()
    bent[:, 2] += corners.sag @ rig.bend
    views = zip(rig.boards, corners.views, strict=True)
    return np.concatenate([pose.apply(bent[view]) for pose, view in views])
