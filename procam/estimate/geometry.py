"""Camera pose and projector models from decoded dome points on an exact sphere (science.md s.3)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import rq
from scipy.optimize import least_squares

from procam.errors import CalibrationError, NotEnoughData
from procam.maths.lenses import Lens, project, unproject
from procam.maths.pose import Pose, align_rotation, rotation_matrix
from procam.maths.sphere import intersect_sphere
from procam.maths.warp import block_mean
from procam.model.correspondence import CorrespondenceMap
from procam.model.optics import CameraModel, Fiducial, ProjectorModel
from procam.model.screen import Dome

Array = NDArray[np.float64]
BLOCK_PX = 8
FULL_BLOCK = 0.95
CAMERA_PARAMETERS, PROJECTOR_PARAMETERS = 6, 12
ITERATIONS = 25
CONVERGED = 1e-9
OUTLIER_SIGMAS = 6.0
MIN_BLOCKS = 60


@dataclass(frozen=True, slots=True)
class Observations:
    """Camera pixels (N, 2) and the projector pixels (N, 2) they see, each a mean over a block."""

    camera_px: Array
    projector_px: Array


@dataclass(frozen=True, slots=True)
class GeometrySolution:
    """Solved rig.

    Attributes
    ----------
    camera, projectors : models with poses; projectors carry their covariance.
    covariance : (P, P) of all free parameters: six of the camera (turn, shift), then twelve per
        projector.
    observations, residual_px : per projector, what was fitted and what is left (N, 2).
    """

    camera: CameraModel
    projectors: dict[str, ProjectorModel]
    covariance: Array
    observations: dict[str, Observations]
    residual_px: dict[str, Array]


def gather(found: CorrespondenceMap, block: int = BLOCK_PX) -> Observations:
    """Means over blocks of camera pixels that are decoded (nearly) throughout.

    A mean of 64 integers with different fractions beats their rounding by a factor of eight.
    """
    height, width = found.valid.shape
    share = block_mean(found.valid.astype(np.float32), block)
    weight = np.maximum(share, 1e-6)[..., None]
    xy = block_mean(np.nan_to_num(found.projector_xy), block) / weight
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32)
    where = block_mean(np.where(found.valid[..., None], pixels, 0), block) / weight
    keep = share > FULL_BLOCK
    return Observations(where[keep].astype(float), xy[keep].astype(float))


def locate_camera(camera: CameraModel, dome: Dome, fiducials: list[Fiducial]) -> CameraModel:
    """Camera pose from three or more fiducials on the sphere, started from the dome's centre."""
    marks = [f for f in fiducials if f.camera == camera.name]
    if len(marks) < 3:
        raise NotEnoughData(
            f"camera {camera.name}: got {len(marks)} fiducials, expected at least 3; list more "
            "[[fiducials]] in venue.toml: without them the dome's front and left are unknown"
        )
    points = dome.radius_m * np.array([f.direction for f in marks])
    pixels = np.array([f.pixel for f in marks])
    rotation = align_rotation(points / dome.radius_m, unproject(pixels, camera.lens))

    def residual(x: Array, pull: float) -> Array:
        pose = _moved(Pose(rotation, np.zeros(3)), x)
        miss = (project(pose.apply(points), camera.lens) - pixels).ravel()
        return np.r_[np.nan_to_num(miss, nan=1e4), pull * pose.origin]

    # three points fit up to four camera places: a pull to the centre first finds the one near it
    scale = [0.1] * 3 + [0.1 * dome.radius_m] * 3
    near = least_squares(residual, np.zeros(6), x_scale=scale, args=(20 / dome.radius_m,))
    fit = least_squares(residual, near.x, x_scale=scale, args=(0.0,))
    miss = float(np.sqrt(np.mean(fit.fun**2)))
    if miss > 5.0:
        raise CalibrationError(
            f"camera {camera.name}: the fiducials miss by {miss:.1f} px at best, expected less "
            "than 5; check their azimuth_deg, elevation_deg and pixel, and the camera's intrinsics"
        )
    return replace(camera, camera_from_dome=_moved(Pose(rotation, np.zeros(3)), fit.x))


def solve_geometry(
    camera: CameraModel,
    dome: Dome,
    fiducials: list[Fiducial],
    observations: Mapping[str, Observations],
    sizes: Mapping[str, tuple[int, int]],
) -> GeometrySolution:
    """Camera pose, projector poses and lenses together; needs no start values.

    Camera pose from the fiducials, projectors by DLT from the dome points that gives, then all of
    it by Gauss-Newton with outliers dropped between two rounds.
    """
    placed = locate_camera(camera, dome, fiducials)
    projectors = {
        name: _resection(name, sizes[name], placed, dome, obs) for name, obs in observations.items()
    }
    problem = _Problem(placed, dome, fiducials, dict(observations), projectors)
    problem.solve()
    problem.drop_outliers()
    problem.solve()
    return problem.solution()


class _Problem:
    """Gauss-Newton over the camera pose and all projectors; normal equations block by block."""

    def __init__(
        self,
        camera: CameraModel,
        dome: Dome,
        fiducials: list[Fiducial],
        observations: dict[str, Observations],
        projectors: dict[str, ProjectorModel],
    ) -> None:
        self.camera, self.dome, self.projectors = camera, dome, projectors
        self.observations = observations
        self.rays = {n: unproject(o.camera_px, camera.lens) for n, o in observations.items()}
        self.fiducials = [f for f in fiducials if f.camera == camera.name]
        self.count = CAMERA_PARAMETERS + PROJECTOR_PARAMETERS * len(projectors)

    def solve(self) -> None:
        """Iterate to convergence with Levenberg damping."""
        damping, cost = 1e-6, self._cost(self.camera, self.projectors)
        for _ in range(ITERATIONS):
            matrix, gradient = self._normal_equations()
            scale = np.sqrt(np.diag(matrix))
            damped = matrix / np.outer(scale, scale) + damping * np.eye(self.count)
            step = -np.linalg.solve(damped, gradient / scale) / scale
            camera, projectors = self._stepped(step)
            new_cost = self._cost(camera, projectors)
            if not new_cost <= cost + 1e-12 * abs(cost):
                damping *= 10
                if damping > 1e6:
                    return
                continue
            gain = (cost - new_cost) / max(abs(cost), 1.0)  # a log-likelihood: often negative
            self.camera, self.projectors, cost = camera, projectors, new_cost
            damping = max(damping / 10, 1e-12)
            if gain < CONVERGED:
                return

    def drop_outliers(self) -> None:
        """Forget blocks whose residual is far outside the crowd's."""
        for name, obs in self.observations.items():
            error = np.linalg.norm(self._residual(self.camera, name, self.projectors[name]), axis=1)
            keep = error < OUTLIER_SIGMAS * 1.4826 * np.median(error)
            self.observations[name] = Observations(obs.camera_px[keep], obs.projector_px[keep])
            self.rays[name] = self.rays[name][keep]

    def solution(self) -> GeometrySolution:
        """The result with its covariance, scaled by the residuals' own variance."""
        residual = {n: self._residual(self.camera, n, p) for n, p in self.projectors.items()}
        matrix, _ = self._normal_equations()
        covariance = np.asarray(np.linalg.inv(matrix), float)
        projectors = {
            name: replace(p, covariance=covariance[self._block(i), self._block(i)])
            for i, (name, p) in enumerate(self.projectors.items())
        }
        return GeometrySolution(self.camera, projectors, covariance, self.observations, residual)

    def _block(self, index: int) -> slice:
        start = CAMERA_PARAMETERS + PROJECTOR_PARAMETERS * index
        return slice(start, start + PROJECTOR_PARAMETERS)

    def _normal_equations(self) -> tuple[Array, Array]:
        matrix, gradient = np.zeros((self.count, self.count)), np.zeros(self.count)
        jacobian, error = self._fiducial_rows()
        own = slice(0, CAMERA_PARAMETERS)
        matrix[own, own] += jacobian.T @ jacobian
        gradient[own] += jacobian.T @ error
        for i, (name, projector) in enumerate(self.projectors.items()):

            def residual(x: Array, n: str = name, p: ProjectorModel = projector) -> Array:
                camera = _moved_camera(self.camera, x[:CAMERA_PARAMETERS])
                return self._residual(
                    camera, n, changed_projector(p, x[CAMERA_PARAMETERS:])
                ).ravel()

            jacobian, error = _differentiate(residual, step_sizes(projector, self.dome))
            weight = 1 / max(float(np.mean(error**2)), 1e-12)
            rows = np.r_[0:CAMERA_PARAMETERS, self._block(i)]
            matrix[np.ix_(rows, rows)] += weight * jacobian.T @ jacobian
            gradient[rows] += weight * jacobian.T @ error
        return matrix, gradient

    def _fiducial_rows(self) -> tuple[Array, Array]:
        return _differentiate(
            lambda x: self._fiducial_residual(_moved_camera(self.camera, x)),
            np.r_[np.full(3, 1e-6), np.full(3, 1e-6 * self.dome.radius_m)],
        )

    def _fiducial_residual(self, camera: CameraModel) -> Array:
        assert camera.camera_from_dome is not None
        points = self.dome.radius_m * np.array([f.direction for f in self.fiducials])
        seen = project(camera.camera_from_dome.apply(points), camera.lens)
        error = seen - np.array([f.pixel for f in self.fiducials])
        sigma_px = np.array([f.sigma for f in self.fiducials]) * float(np.mean(camera.lens.focal))
        return np.asarray((error / sigma_px[:, None]).ravel())

    def _residual(self, camera: CameraModel, name: str, projector: ProjectorModel) -> Array:
        points = points_of_rays(camera, self.dome, self.rays[name])
        seen = project(projector.projector_from_dome.apply(points), projector.lens)
        # a step that puts points behind the projector must cost, not poison
        return np.nan_to_num(seen - self.observations[name].projector_px, nan=1e4)

    def _cost(self, camera: CameraModel, projectors: dict[str, ProjectorModel]) -> float:
        total = float(np.sum(self._fiducial_residual(camera) ** 2))
        for name, projector in projectors.items():
            error = self._residual(camera, name, projector)
            total += error.size * float(np.log(np.mean(error**2) + 1e-12))
        return total

    def _stepped(self, step: Array) -> tuple[CameraModel, dict[str, ProjectorModel]]:
        camera = _moved_camera(self.camera, step[:CAMERA_PARAMETERS])
        projectors = {
            name: changed_projector(p, step[self._block(i)])
            for i, (name, p) in enumerate(self.projectors.items())
        }
        return camera, projectors


def camera_points(camera: CameraModel, dome: Dome, pixels: Array) -> Array:
    """Dome points (..., 3) [m] that camera pixels (..., 2) see on the exact sphere."""
    return points_of_rays(camera, dome, unproject(pixels, camera.lens))


def points_of_rays(camera: CameraModel, dome: Dome, rays: Array) -> Array:
    """Dome points (..., 3) [m] at the end of rays (..., 3) in the camera's frame."""
    if camera.camera_from_dome is None:
        raise CalibrationError(f"camera {camera.name} is not placed yet; solve the geometry first")
    back = camera.camera_from_dome.inverse()
    return intersect_sphere(back.translation, back.rotate(rays), dome.radius_m)


def sphere_test(solution: GeometrySolution, dome: Dome, cells: int = 8) -> tuple[float, float]:
    """Does the exact sphere explain the residuals? (ratio of variances, systematic part [arcmin]).

    Residuals of neighbouring blocks are independent when the model is right, so means over cells
    of `cells` x `cells` blocks scatter by the single variance over their number: ratio 1. A dome
    that is not a sphere leaves smooth fields behind, and the ratio grows far beyond 2.
    """
    observed, expected, systematic = 0.0, 0.0, []
    for name, obs in solution.observations.items():
        residual = solution.residual_px[name]
        cell = np.floor(obs.camera_px / (BLOCK_PX * cells)).astype(int)
        _, index = np.unique(cell, axis=0, return_inverse=True)
        number = np.bincount(index.ravel())
        means = np.stack([np.bincount(index.ravel(), residual[:, i]) / number for i in (0, 1)], 1)
        full = number >= cells * cells / 2
        steps = _neighbour_variance(obs, residual)
        observed += float(np.sum(means[full] ** 2 * number[full, None]))
        expected += float(full.sum()) * float(steps.sum())
        focal = float(np.mean(solution.projectors[name].lens.focal))
        excess = np.maximum(means[full] ** 2 - steps / number[full, None], 0).sum(axis=1).mean()
        distance = np.linalg.norm(solution.projectors[name].projector_from_dome.origin)
        # a projector pixel's shift as seen from the dome's centre, about twice as near
        systematic.append(np.sqrt(excess) / focal * (dome.radius_m + distance) / dome.radius_m)
    return observed / max(expected, 1e-30), float(np.degrees(np.max(systematic)) * 60)


def _neighbour_variance(obs: Observations, residual: Array) -> Array:
    """Variance (2,) of one block's residual from differences of horizontal neighbours."""
    order = np.lexsort((obs.camera_px[:, 0], np.round(obs.camera_px[:, 1] / BLOCK_PX)))
    close = np.abs(np.diff(obs.camera_px[order, 0]) - BLOCK_PX) < BLOCK_PX / 4
    return np.asarray(np.mean(np.diff(residual[order], axis=0)[close] ** 2, axis=0) / 2)


def _resection(
    name: str, size: tuple[int, int], camera: CameraModel, dome: Dome, obs: Observations
) -> ProjectorModel:
    """Start value of a projector by the direct linear transform (Hartley & Zisserman, s. 7.1)."""
    if len(obs.camera_px) < MIN_BLOCKS:
        raise NotEnoughData(
            f"projector {name}: got {len(obs.camera_px)} decoded blocks, expected at least "
            f"{MIN_BLOCKS}; is it on, in focus and inside the camera's view?"
        )
    points = camera_points(camera, dome, obs.camera_px)
    if not np.isfinite(points).all():
        raise CalibrationError(
            f"camera {camera.name}: the fiducials put it where it cannot see the dome; check their "
            "azimuth_deg, elevation_deg and pixel, and radius_m"
        )
    scaled = np.c_[points / dome.radius_m, np.ones(len(points))]
    xy = obs.projector_px / max(size)
    zero = np.zeros_like(scaled)
    rows = np.r_[np.c_[scaled, zero, -xy[:, :1] * scaled], np.c_[zero, scaled, -xy[:, 1:] * scaled]]
    matrix = np.linalg.eigh(rows.T @ rows)[1][:, 0].reshape(3, 4)
    if np.median(scaled @ matrix[2]) < 0:
        matrix = -matrix
    triangle, rotation = rq(matrix[:, :3])
    sign = np.diag(np.sign(np.diag(triangle)))
    triangle, rotation = triangle @ sign, sign @ rotation
    translation = np.linalg.solve(triangle, matrix[:, 3]) * dome.radius_m
    if np.linalg.det(rotation) < 0:
        raise CalibrationError(
            f"projector {name}: its picture arrives mirrored, expected a right-reading one; "
            "switch off rear projection or flip in its menu"
        )
    triangle = triangle / triangle[2, 2] * max(size)
    lens = Lens(
        "brown",
        np.array([triangle[0, 0], triangle[1, 1]]),
        np.array([triangle[0, 2], triangle[1, 2]]),
        np.zeros(5),
    )
    return ProjectorModel(name, size, lens, Pose(rotation, translation))


def _moved(pose: Pose, x: Array) -> Pose:
    """`pose` turned by the rotation vector x[:3] about the device and shifted by x[3:] [m]."""
    turn = rotation_matrix(x[:3])
    return Pose(turn @ pose.rotation, turn @ pose.translation + x[3:])


def _moved_camera(camera: CameraModel, x: Array) -> CameraModel:
    assert camera.camera_from_dome is not None
    return replace(camera, camera_from_dome=_moved(camera.camera_from_dome, x))


def changed_projector(projector: ProjectorModel, x: Array) -> ProjectorModel:
    """A projector stepped by (12,): turn, shift [m], focal and centre [px], k1, k2."""
    lens = projector.lens
    k = lens.distortion + np.array([x[10], x[11], 0.0, 0.0, 0.0])
    return replace(
        projector,
        lens=Lens(lens.kind, lens.focal + x[6:8], lens.centre + x[8:10], k),
        projector_from_dome=_moved(projector.projector_from_dome, x[:6]),
    )


def step_sizes(projector: ProjectorModel, dome: Dome) -> Array:
    """Steps (18,) for numerical derivatives by the camera's and one projector's parameters."""
    turn, shift, px = np.full(3, 1e-6), np.full(3, 1e-6 * dome.radius_m), np.full(4, 1e-4)
    return np.r_[turn, shift, turn, shift, px, 1e-7, 1e-7]


def _differentiate(function: Callable[[Array], Array], steps: Array) -> tuple[Array, Array]:
    """Jacobian by central differences at zero, and the value there."""
    columns = []
    for i, step in enumerate(steps):
        x = np.zeros(len(steps))
        x[i] = step
        columns.append((function(x) - function(-x)) / (2 * step))
    return np.stack(columns, axis=1), function(np.zeros(len(steps)))
