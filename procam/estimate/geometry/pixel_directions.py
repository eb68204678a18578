"""Directions of a projector's pixels: measured where cameras saw them, modelled elsewhere.

The model is the solved rig: the pixel's ray meets the screen. The difference to the directions that
cameras measured is averaged over cells of the panel, smoothed, reduced by the share of its variance
that noise explains, and added to the model. The standard error combines, at the nodes of a coarse
grid, the propagated covariance of the rig with the uncertainty of that field
(docs/theory/geometry.md).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, BoolArray, IndexArray, Map
from procam.estimate.geometry.model import (
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    points_seen,
    project_to_camera,
    residuals,
)
from procam.estimate.geometry.screen_points import intersect_screen
from procam.estimate.geometry.solve import GeometrySolution
from procam.maths.geometry.lenses import unproject
from procam.maths.geometry.sphere import ARCMIN, normalise
from procam.maths.statistics import robust_sigma
from procam.maths.warp import blur, blur_within, sample
from procam.model.optics import ProjectorModel

DirectionsOf = Callable[[RigGeometry], Array]
CELL_PX = 16  # of the panel, over which measurements are averaged
SMOOTH = 1.0  # cells
ROUGH = 3.0  # cells over which the detail that smoothing removes has the same variance
SIGNIFICANT = (
    0.5  # weight of the field from which the detail that smoothing removes is not all noise
)
FILL = (2.0, 6.0, 24.0)  # cells, ever wider, over which holes are filled from their surroundings
REACHED = 0.02  # share of measured cells around a hole, from which it is filled
SIGMA_GRID = 12  # nodes along the short edge at which standard errors are propagated
STEP = 1e-4  # of the radius, for numerical derivatives


@dataclass(frozen=True, slots=True)
class PixelDirections:
    """A projector's directions: those of its model plus a smooth measured field.

    Attributes
    ----------
    field : (h, w, 3) on cells of `CELL_PX`.
    variance : (h', w') of the direction, sum of both components [rad^2], per node of a coarse grid.
    unknown : (h', w') the part of it that comes from the field.
    rays : (h', w') per camera, weight with which the direction follows its rays, not the model [-].
    """

    rig: RigGeometry
    projector: ProjectorModel
    field: Map
    variance: Map
    unknown: Map
    rays: Mapping[str, Map]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the panel [px]."""
        return self.projector.size

    def directions(self, x: NDArray[np.generic], y: NDArray[np.generic]) -> Array:
        """Unit directions (len(y), len(x), 3) of the panel's points (x, y) [px]; NaN if they miss."""
        return self.at(np.stack(np.meshgrid(x, y), axis=-1).astype(float))

    def at(self, pixels: Array) -> Array:
        """Unit directions (H, W, 3) of any points (H, W, 2) of the panel [px]; NaN if they miss."""
        model = model_directions(self.rig, self.projector, pixels)
        if not self.field.any():
            return model
        cell = np.clip((pixels + 0.5) / CELL_PX - 0.5, 0, np.array(self.field.shape[1::-1]) - 1.0)
        return normalise(model + sample(self.field, cell))

    def sigma_arcmin(self, x: NDArray[np.generic], y: NDArray[np.generic]) -> Map:
        """Standard error (len(y), len(x)) of the direction, both components together [arcmin]."""
        where = self.nodes(np.stack(np.meshgrid(x, y), axis=-1).astype(float))
        return np.asarray(ARCMIN * np.sqrt(sample(self.variance, where)), np.float32)

    def nodes(self, pixels: Array) -> Array:
        """Coordinates (..., 2) on the coarse grid of the panel's points (..., 2) [px]."""
        rows, columns = self.variance.shape
        return pixels * ((np.array([columns, rows]) - 1) / (np.array(self.size) - 1))


def model_directions(rig: RigGeometry, projector: ProjectorModel, pixels: Array) -> Array:
    """Directions (..., 3) of projector pixels (..., 2) by the models alone; NaN if they miss."""
    back = projector.projector_from_dome.inverse()
    rays = back.rotate(unproject(pixels, projector.lens))
    return normalise(intersect_screen(rig.shape, back.translation, rays))


def fit_pixel_directions(solution: GeometrySolution, name: str) -> PixelDirections:
    """Directions of one projector from all observations of it."""
    rig, projector = solution.rig, solution.rig.projectors[name]
    if name in solution.given:
        return _given(rig, projector, solution.given[name])
    views = {p: o for p, o in solution.observations.items() if p[1] == name}
    deviation = _shape_deviation(rig, solution.observations)
    parts = [_measured(rig, pair, some, deviation) for pair, some in views.items()]
    pixels, error, noise, parallax = (np.concatenate(part) for part in zip(*parts, strict=True))
    cells = _CellMeans(projector.size, pixels, 1 / (noise + parallax))
    field, variance, weight = _smooth_field(cells, error, noise, parallax)
    return PixelDirections(
        rig, projector, field, *_variance_maps(solution, name, list(views), variance, weight)
    )


def _given(rig: RigGeometry, projector: ProjectorModel, sigma_arcmin: float) -> PixelDirections:
    """Directions that the model defines, as those of dome masters."""
    variance = np.full((2, 2), (sigma_arcmin / ARCMIN) ** 2, np.float32)
    return PixelDirections(rig, projector, np.zeros((1, 1, 3), np.float32), variance, variance, {})


def _shape_deviation(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> float:
    """Rms deviation of the screen from its model, relative to the radius, from the residuals."""
    steps = []
    shape = replace(rig.shape, radius_m=rig.shape.radius_m * (1 + STEP))
    larger = RigGeometry(shape, rig.cameras, rig.projectors)
    for pair, some in seen.items():
        error = residuals(rig, pair, some)
        slope = (residuals(larger, pair, some) - error) / STEP
        size = np.sum(slope**2, axis=1)
        step = np.sum(error * slope, axis=1) / np.maximum(size, 1e-30)
        noise = some.sigma_px**2 / np.maximum(size, 1e-30)
        steps.append([robust_sigma(step, 0.0), np.sqrt(np.median(noise))])
    total, noise = np.mean(np.square(steps), axis=0)
    return float(np.sqrt(max(total - noise, 0.0)))


def _measured(
    rig: RigGeometry, pair: Pair, seen: Observations, deviation: float
) -> tuple[Array, Array, Array, Array]:
    """Projector pixels (N, 2), measured minus modelled direction (N, 3), variances (N,) [rad^2].

    The variances, per component, are those of noise and of parallax: a camera off the centre takes a
    deviation of the screen's shape for a change of direction.
    """
    camera, projector = rig.cameras[pair[0]], rig.projectors[pair[1]]
    assert camera.camera_from_dome is not None
    point = points_seen(rig, pair[0], seen.camera_px)
    unit = normalise(point)
    model = model_directions(rig, projector, seen.projector_px)
    per_px = model_directions(rig, projector, seen.projector_px + 1.0) - model
    noise = (seen.sigma_px * np.linalg.norm(per_px, axis=1)) ** 2 / 2
    line = normalise(point - camera.camera_from_dome.origin)
    cosine = np.sum(line * unit, axis=1)
    tangent = np.linalg.norm(line - unit * cosine[:, None], axis=1) / cosine
    good = np.isfinite(noise) & np.isfinite(unit - model).all(axis=1)
    parallax = (deviation * tangent) ** 2 / 2
    return seen.projector_px[good], (unit - model)[good], noise[good], parallax[good]


class _CellMeans:
    """Weighted means over cells of a panel; `known` (h, w) where a cell has `count` > 0 values."""

    def __init__(self, size: tuple[int, int], pixels: Array, weight: Array) -> None:
        width, height = size
        self._shape = (-(-height // CELL_PX), -(-width // CELL_PX))
        cell = np.clip((pixels + 0.5) / CELL_PX, 0, np.array(self._shape[::-1]) - 1).astype(int)
        self._index, self._weight = cell[:, 1] * self._shape[1] + cell[:, 0], weight
        self.count = self._sum(np.ones_like(weight))
        self._total = self._sum(weight)
        self.known = self.count > 0

    def of(self, values: Array) -> Array:
        """Means (h, w, C) of values (N, C); 0 where there are none."""
        sums = [self._sum(self._weight * column) for column in values.T]
        total = np.where(self.known, self._total, 1.0)
        return np.stack(sums, axis=-1) / total[..., None]

    def _sum(self, values: Array) -> Array:
        height, width = self._shape
        sums = np.bincount(self._index, values, height * width).reshape(height, width)
        return np.asarray(sums, float)


def _smooth_field(
    cells: _CellMeans, error: Array, noise: Array, parallax: Array
) -> tuple[Map, Array, float]:
    """Field (h, w, 3) added to the model, its variance (h, w) or NaN where unknown, and its weight.

    The weight is the share of the field's variance that noise does not explain, 0 to 1. Variances
    count both components of a direction; smoothing averages noise, but not parallax.
    """
    mean, known = cells.of(error).astype(np.float32), cells.known
    smooth = blur_within(mean, known, SMOOTH)
    noise_of_mean = 2 * cells.of(noise[:, None])[..., 0] / np.maximum(cells.count, 1)
    noise_of_smooth = noise_of_mean / (4 * np.pi * SMOOTH**2)
    rough = np.sum((mean - smooth) ** 2, axis=-1) - (noise_of_mean - noise_of_smooth)
    weight = 1 - np.mean(noise_of_smooth[known]) / np.mean(np.sum(smooth[known] ** 2, axis=-1))
    weight = float(np.clip(weight, 0, 1))
    detail = np.maximum(blur_within(rough, known, ROUGH), 0) * (weight > SIGNIFICANT)
    variance = noise_of_smooth + 2 * cells.of(parallax[:, None])[..., 0] + detail
    field = _filled(np.float32(weight) * smooth, known)
    return field, np.where(known, variance, np.nan), weight


def _filled(field: Map, known: BoolArray) -> Map:
    """A field (h, w, 3) with its holes filled from their surroundings; 0 far from any value."""
    filled, there = np.where(known[..., None], field, np.float32(0)), known.copy()
    for width in FILL:
        reached = blur(there.astype(np.float32), width) > REACHED
        near = blur_within(filled, there, width)
        filled = np.where((reached & ~there)[..., None], near, filled)
        there |= reached
    return filled


def _variance_maps(
    solution: GeometrySolution, name: str, pairs: Sequence[Pair], field: Array, weight: float
) -> tuple[Map, Map, dict[str, Map]]:
    """`variance`, `unknown` and `rays` of `PixelDirections`, per node of the coarse grid.

    `field` (h, w) is the measured field's variance. Where it is NaN the model's variance applies,
    plus the mean misfit of the measured part.
    """
    grid = panel_grid(solution.projectors[name].size)
    cameras, nodes = [camera for camera, _ in pairs], grid.reshape(-1, 2)
    modelled, rays = _propagated_variances(solution, name, cameras, nodes)
    best, ray = rays.argmin(axis=0), rays.min(axis=0)
    cell = np.clip(((nodes + 0.5) / CELL_PX).astype(int), 0, np.array(field.shape[::-1]) - 1)
    at_nodes = field[cell[:, 1], cell[:, 0]]
    seen = np.isfinite(at_nodes) & np.isfinite(ray)
    elsewhere = weight * np.nanmean(field) if seen.any() else 0.0
    share, unknown = weight * seen, np.where(seen, weight * at_nodes, elsewhere)
    variance = share * np.where(seen, ray, 0.0) + (1 - share) * modelled + unknown
    maps = [variance, unknown, *(share * (best == i) for i in range(len(cameras)))]
    first, second, *counts = (m.reshape(grid.shape[:2]).astype(np.float32) for m in maps)
    return first, second, dict(zip(cameras, counts, strict=True))


def panel_grid(size: tuple[int, int]) -> Array:
    """Nodes (h', w', 2) [px] over a panel, from its first pixel to its last."""
    width, height = size
    columns = max(SIGMA_GRID, round(SIGMA_GRID * width / height))
    x, y = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, SIGMA_GRID)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _propagated_variances(
    solution: GeometrySolution, name: str, cameras: Sequence[str], nodes: Array
) -> tuple[Array, Array]:
    """Variances [rad^2] of the directions at nodes (N, 2), from the covariance of the rig.

    Of the model (N,), and of each camera's rays (C, N), infinite where the camera does not see.
    """
    rig, layout = solution.rig, ParameterLayout.of(solution.rig)
    own = np.r_[layout.screen, layout.projectors[name]]
    modelled = _propagated(solution, own, lambda r: model_directions(r, r.projectors[name], nodes))
    points = intersect_screen(
        rig.shape, np.zeros(3), model_directions(rig, rig.projectors[name], nodes)
    )
    rays = np.stack([_propagated(solution, *ray_directions(rig, c, points)) for c in cameras])
    return modelled, np.nan_to_num(rays, nan=np.inf)


def ray_directions(rig: RigGeometry, camera: str, points: Array) -> tuple[IndexArray, DirectionsOf]:
    """Directions (N, 3) of what a camera sees in the pixels of points (N, 3) [m], as the rig changes.

    Returns the parameters that they depend on, and a function of the rig.
    """
    layout, pixels = ParameterLayout.of(rig), project_to_camera(rig.cameras[camera], points)
    return np.r_[layout.screen, layout.cameras[camera]], lambda r: normalise(
        points_seen(r, camera, pixels)
    )


def _propagated(solution: GeometrySolution, columns: IndexArray, directions: DirectionsOf) -> Array:
    """Variance (N,) [rad^2], sum of both components, of directions that depend on some parameters."""
    sigma = np.sqrt(np.diag(solution.covariance))
    used = columns[sigma[columns] > 0]
    if not used.size:  # all of them are known
        known = np.isfinite(directions(solution.rig)).all(axis=-1)
        return np.where(known, 0.0, np.nan)
    slopes = []
    for i in used:
        step = np.zeros(len(sigma))
        step[i] = 0.1 * sigma[i]
        ahead, behind = directions(solution.rig.moved(step)), directions(solution.rig.moved(-step))
        slopes.append((ahead - behind) / (0.2 * sigma[i]))
    slope = np.stack(slopes, axis=-1)
    covariance = solution.covariance[np.ix_(used, used)]
    return np.asarray(np.einsum("nip,pq,niq->n", slope, covariance, slope))
