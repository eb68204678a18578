"""Bundle adjustment of a board: lenses, device poses, board poses and the board's bend.

The residuals are predicted minus observed corner pixels; `maths.levenberg` minimises their squares,
or a Cauchy loss while outliers are among them, with analytic derivatives. A view's board pose occurs
only in the residuals of that view, so the poses are eliminated from the normal equations first (Schur
complement; Triggs et al. 2000, doi:10.1007/3-540-44480-7_21): the time of a step is proportional to
the number of views.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procam.arrays import Array, IndexArray
from procam.estimate.boards.corners import BoardRig, Corners, corner_points, residuals
from procam.maths.geometry.lenses import (
    lens_of_parameters,
    lens_parameters,
    project_with_derivatives,
)
from procam.maths.levenberg import minimise

ITERATIONS = 200
LEAST_DAMPING = 1e-9  # of a step for its own sake: a pose with few corners stays solvable
SINGULAR = 1e-13  # eigenvalue of the scaled normal matrix below which a direction is not determined
CAUCHY_SIGMAS = 3.0  # residual from which the robust loss falls behind the square


@dataclass(frozen=True)
class BoardAdjustment:
    """One least-squares problem.

    Attributes
    ----------
    corners : the observations.
    free : per device, which of `lens_parameters` are solved for.
    sigma_px : (D,) standard deviation of an observation per axis [px].
    bend : solve for the bend of the board.
    robust : use the Cauchy loss, for corners with outliers among them.
    """

    corners: Corners
    free: tuple[tuple[int, ...], ...]
    sigma_px: Array
    bend: bool = False
    robust: bool = False

    def solve(self, rig: BoardRig, iterations: int = ITERATIONS) -> tuple[BoardRig, bool]:
        """The nearest minimum, and whether it was reached within `iterations`."""
        return minimise(rig, self.cost, self._linearise, iterations=iterations)

    def cost(self, rig: BoardRig) -> float:
        """Sum of the losses of the observations in use; infinite if a corner lies behind its device."""
        squared = np.sum(residuals(self.corners, rig) ** 2, axis=2) / self.sigma_px[:, None] ** 2
        squared = squared[self.corners.use]
        if not np.isfinite(squared).all():
            return np.inf
        limit = CAUCHY_SIGMAS**2
        return float(np.sum(limit * np.log1p(squared / limit) if self.robust else squared))

    def shared_step(self, rig: BoardRig) -> Array:
        """The Gauss-Newton step (S,) of the shared parameters from `rig`, all poses following."""
        return self._equations(rig).step(LEAST_DAMPING)[0]

    def covariance(self, rig: BoardRig) -> Array:
        """Covariance (S, S) of the shared parameters by noise alone, from the residual variance.

        Order: for each device its free lens parameters and, except for the first, its rotation [rad]
        and translation [m]; then the bend [m]. Directions that no view determines have very large
        variances.
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
        """Number S of parameters that all views share."""
        return sum(map(len, self.free)) + 6 * (len(self.free) - 1) + 3 * self.bend

    def _linearise(self, rig: BoardRig) -> Callable[[float], BoardRig]:
        """Normal equations at `rig`, as the function from damping to trial rig."""
        equations = self._equations(rig)
        return lambda damping: self._stepped(rig, *equations.step(damping))

    def _equations(self, rig: BoardRig) -> "_BoardEquations":
        sums = _BoardEquations(self.shared, len(rig.boards))
        for device, use in enumerate(self.corners.use):
            index = np.flatnonzero(use)
            rows, own, error = self._rows(rig, device, index)
            ends = np.searchsorted(index, self.corners.starts)
            for view, (start, stop) in enumerate(itertools.pairwise(ends)):
                part = slice(2 * start, 2 * stop)
                sums.add(view, rows[part], own[part], error[part])
        return sums

    def _rows(self, rig: BoardRig, device: int, index: IndexArray) -> tuple[Array, Array, Array]:
        """Weighted derivatives (2n, S), (2n, 6) and residuals (2n,) of n observations of a device."""
        pose, (lens, own_pose) = rig.devices[device], self._blocks[device]
        point = corner_points(self.corners, rig)[index]
        in_device = pose.apply(point)
        pixel, by_device, by_lens = project_with_derivatives(in_device, rig.lenses[device])
        by_point = by_device @ pose.rotation
        rows = np.zeros((len(index), 2, self.shared))
        rows[:, :, lens] = by_lens[:, :, list(self.free[device])]
        if device:
            rows[:, :, own_pose] = _by_step(in_device, by_device)
        if self.bend:
            normals = np.array([b.rotation[:, 2] for b in rig.boards])[self.corners.view_of[index]]
            by_height = np.einsum("nij,nj->ni", by_point, normals)
            rows[:, :, -3:] = by_height[:, :, None] * self.corners.sag[index, None, :]
        error = pixel - self.corners.pixels[device, index]
        root = self._root_weights(error, self.sigma_px[device])
        own = _by_step(point, by_point)
        return (
            (rows * root[:, None, None]).reshape(2 * len(index), self.shared),
            (own * root[:, None, None]).reshape(2 * len(index), 6),
            (error * root[:, None]).ravel(),
        )

    def _root_weights(self, error: Array, sigma_px: float) -> Array:
        """Square roots (n,) of the weights of residuals (n, 2), 1/sigma where not robust."""
        squared = np.sum(error**2, axis=1) / sigma_px**2
        weight = 1 / (1 + squared / CAUCHY_SIGMAS**2) if self.robust else np.ones(len(error))
        return np.asarray(np.sqrt(weight) / sigma_px)

    @cached_property
    def _blocks(self) -> list[tuple[slice, slice]]:
        """Where each device's lens and pose are among the shared parameters."""
        blocks, start = [], 0
        for device, free in enumerate(self.free):
            lens = slice(start, start + len(free))
            pose = slice(lens.stop, lens.stop + (6 if device else 0))  # the first one's is fixed
            blocks.append((lens, pose))
            start = pose.stop
        return blocks

    def _stepped(self, rig: BoardRig, shared: Array, own: Array) -> BoardRig:
        lenses, devices = list(rig.lenses), list(rig.devices)
        for i, (lens, pose) in enumerate(self._blocks):
            parameters = lens_parameters(lenses[i])
            parameters[list(self.free[i])] += shared[lens]
            lenses[i] = lens_of_parameters(lenses[i], parameters)
            if i:
                devices[i] = devices[i].moved(shared[pose])
        boards = (board.moved(x) for board, x in zip(rig.boards, own, strict=True))
        bend = rig.bend + shared[-3:] if self.bend else rig.bend
        return BoardRig(tuple(lenses), tuple(devices), tuple(boards), bend)


class _BoardEquations:
    """Normal equations of S shared parameters and V board poses.

    `matrix` (S, S), `cross` (V, S, 6), `own` (V, 6, 6), `gradient` (S,), `own_gradient` (V, 6).
    """

    def __init__(self, shared: int, views: int) -> None:
        self.matrix, self.gradient = np.zeros((shared, shared)), np.zeros(shared)
        self.own, self.own_gradient = np.zeros((views, 6, 6)), np.zeros((views, 6))
        self.cross = np.zeros((views, shared, 6))

    def add(self, view: int, rows: Array, own: Array, error: Array) -> None:
        """Add rows (n, S) and (n, 6) of one view with residuals (n,)."""
        self.matrix[:] += rows.T @ rows
        self.cross[view] += rows.T @ own
        self.own[view] += own.T @ own
        self.gradient[:] += rows.T @ error
        self.own_gradient[view] += own.T @ error

    def reduced(self, damping: float) -> tuple[Array, Array, Array, Array]:
        """Damped matrix (S, S) and gradient (S,) with the poses eliminated.

        Also the poses' response (V, 6, S) to the shared parameters, and their own step (V, 6).
        """
        diagonal = np.diagonal(self.own, axis1=1, axis2=2)
        # 1 keeps the pose of a view without observations
        extra = np.where(diagonal > 0, damping * diagonal, 1.0)
        own = self.own + extra[:, :, None] * np.eye(6)
        response: Array = np.linalg.solve(own, np.swapaxes(self.cross, 1, 2)).astype(float)
        own_step: Array = np.linalg.solve(own, self.own_gradient[:, :, None]).astype(float)
        matrix = self.matrix + damping * np.diag(np.diag(self.matrix))
        matrix = matrix - np.einsum("vsi,vit->st", self.cross, response)
        gradient = self.gradient - np.einsum("vsi,vi->s", self.cross, own_step[:, :, 0])
        return matrix, gradient, response, own_step[:, :, 0]

    def step(self, damping: float) -> tuple[Array, Array]:
        """Damped Gauss-Newton step of the shared parameters (S,) and of each pose (V, 6)."""
        matrix, gradient, response, own_step = self.reduced(damping)
        scale = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        unit = matrix / np.outer(scale, scale)
        shared = -np.linalg.lstsq(unit, gradient / scale, rcond=1e-15)[0] / scale
        return shared, -own_step - response @ shared


def _by_step(points: Array, by_point: Array) -> Array:
    """Derivatives (N, 2, 6) by the x of `Pose.moved`, from those by the point (N, 2, 3)."""
    return np.concatenate([np.cross(points[:, None, :], by_point), by_point], axis=2)
