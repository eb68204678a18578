"""Directions of a projector's pixels: measured where cameras saw them, modelled elsewhere."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.estimate.bundle import Layout, Observations, Pair, Rig, points_seen, residuals
from procam.estimate.geometry import GeometrySolution
from procam.estimate.shapes import land
from procam.maths.lenses import project, unproject
from procam.maths.sphere import normalise
from procam.maths.warp import blur, blur_within, sample
from procam.model.optics import ProjectorModel

Array = NDArray[np.float64]
Map = NDArray[np.float32]
CELL_PX = 16  # of the panel, over which what was measured is averaged
SMOOTH = 1.0  # cells
ROUGH = 3.0  # cells over which detail that was smoothed away is alike
BELIEVED = 0.5  # trust in the field, from which on what is left of detail is more than noise
FILL = (2.0, 6.0, 24.0)  # cells, ever wider, over which holes take their neighbours' error
REACHED = 0.02  # weight of what is known around a hole, from which on it is filled
SIGMA_GRID = 12  # nodes along the short edge at which standard errors are propagated
STEP = 1e-4  # of the radius, for slopes
ARCMIN = np.degrees(1) * 60


@dataclass(frozen=True, slots=True)
class Landing:
    """A projector's directions: those of its model plus a smooth field of what was measured.

    Attributes
    ----------
    field : (h, w, 3) on cells of `CELL_PX`. variance : (h', w') of the direction [rad^2], per node
        of a coarse grid over the panel.
    """

    rig: Rig
    projector: ProjectorModel
    field: Map
    variance: Map

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
        """Standard error (len(y), len(x)) of the direction, both ways together [arcmin]."""
        rows, columns = self.variance.shape
        scale = (np.array([columns, rows]) - 1) / (np.array(self.size) - 1)
        where = np.stack(np.meshgrid(x, y), axis=-1) * scale
        return np.asarray(ARCMIN * np.sqrt(sample(self.variance, where)), np.float32)


def model_directions(rig: Rig, projector: ProjectorModel, pixels: Array) -> Array:
    """Directions (..., 3) of projector pixels (..., 2) by the models alone; NaN if they miss."""
    back = projector.projector_from_dome.inverse()
    rays = back.rotate(unproject(pixels, projector.lens))
    return normalise(land(rig.shape, back.translation, rays))


def measure_landing(solution: GeometrySolution, name: str) -> Landing:
    """Directions of one projector from everything that cameras saw of it."""
    rig, projector = solution.rig, solution.rig.projectors[name]
    views = {p: o for p, o in solution.observations.items() if p[1] == name}
    relief = _relief(rig, solution.observations)
    parts = [_measured(rig, pair, some, relief) for pair, some in views.items()]
    pixels, off, noise, tilt = (np.concatenate(part) for part in zip(*parts, strict=True))
    cells = _Cells(projector.size, pixels, 1 / (noise + tilt))
    mean, known = cells.means(off).astype(np.float32), cells.known
    smooth = blur_within(mean, known, SMOOTH)
    # a direction errs two ways; of the noise some is left after smoothing, of what bumps do all
    noisy = 2 * cells.means(noise[:, None])[..., 0] / np.maximum(cells.count, 1)
    left = noisy / (4 * np.pi * SMOOTH**2)
    rough = np.sum((mean - smooth) ** 2, axis=-1) - (noisy - left)
    trust = 1 - np.mean(left[known]) / np.mean(np.sum(smooth[known] ** 2, axis=-1))
    trust = float(np.clip(trust, 0, 1))
    detail = np.maximum(blur_within(rough, known, ROUGH), 0) * (trust > BELIEVED)
    spread = left + 2 * cells.means(tilt[:, None])[..., 0] + detail
    return Landing(
        rig,
        projector,
        _filled(np.float32(trust) * smooth, known),
        _variance(solution, name, list(views), np.where(known, spread, np.nan), trust),
    )


def _relief(rig: Rig, seen: Mapping[Pair, Observations]) -> float:
    """How far the screen differs from its model, rms relative to the radius, as residuals tell."""
    steps = []
    shape = replace(rig.shape, radius_m=rig.shape.radius_m * (1 + STEP))
    higher = Rig(shape, rig.cameras, rig.projectors)
    for pair, some in seen.items():
        error = residuals(rig, pair, some)
        slope = (residuals(higher, pair, some) - error) / STEP
        size = np.sum(slope**2, axis=1)
        step = np.sum(error * slope, axis=1) / np.maximum(size, 1e-30)
        noise = some.sigma_px**2 / np.maximum(size, 1e-30)
        steps.append([np.median(np.abs(step)) * 1.4826, np.sqrt(np.median(noise))])
    told, noise = np.mean(np.square(steps), axis=0)
    return float(np.sqrt(max(told - noise, 0.0)))


def _measured(
    rig: Rig, pair: Pair, seen: Observations, relief: float
) -> tuple[Array, Array, Array, Array]:
    """Projector pixels (N, 2), measured minus modelled direction (N, 3), variances (N,) [rad^2].

    Variances of noise, and of what the screen's own shape does: a camera off the centre mistakes
    height for direction. Both are of one way across.
    """
    camera, projector = rig.cameras[pair[0]], rig.projectors[pair[1]]
    assert camera.camera_from_dome is not None
    point = points_seen(rig, pair[0], seen.camera_px)
    unit = normalise(point)
    model = model_directions(rig, projector, seen.projector_px)
    aside = model_directions(rig, projector, seen.projector_px + 1.0) - model
    noise = (seen.sigma_px * np.linalg.norm(aside, axis=1)) ** 2 / 2
    line = normalise(point - camera.camera_from_dome.origin)
    steep = np.sum(line * unit, axis=1)
    slant = np.linalg.norm(line - unit * steep[:, None], axis=1) / steep
    good = np.isfinite(noise) & np.isfinite(unit - model).all(axis=1)
    tilt = (relief * slant) ** 2 / 2
    return seen.projector_px[good], (unit - model)[good], noise[good], tilt[good]


class _Cells:
    """Weighted means over cells of a panel; `known` (h, w) where there is something, `count` of it."""

    def __init__(self, size: tuple[int, int], pixels: Array, weight: Array) -> None:
        width, height = size
        self._shape = (-(-height // CELL_PX), -(-width // CELL_PX))
        cell = np.clip((pixels + 0.5) / CELL_PX, 0, np.array(self._shape[::-1]) - 1).astype(int)
        self._index, self._weight = cell[:, 1] * self._shape[1] + cell[:, 0], weight
        self.count = self._sum(np.ones_like(weight))
        self._total = self._sum(weight)
        self.known = self.count > 0

    def means(self, values: Array) -> Array:
        """Means (h, w, C) of values (N, C); 0 where there are none."""
        sums = [self._sum(self._weight * column) for column in values.T]
        total = np.where(self.known, self._total, 1.0)
        return np.stack(sums, axis=-1) / total[..., None]

    def _sum(self, values: Array) -> Array:
        height, width = self._shape
        sums = np.bincount(self._index, values, height * width).reshape(height, width)
        return np.asarray(sums, float)


def _filled(field: Map, known: NDArray[np.bool_]) -> Map:
    """A field (h, w, 3) with its holes filled from around; 0 where nothing is near."""
    filled, there = np.where(known[..., None], field, np.float32(0)), known.copy()
    for width in FILL:
        reached = blur(there.astype(np.float32), width) > REACHED
        near = blur_within(filled, there, width)
        filled = np.where((reached & ~there)[..., None], near, filled)
        there |= reached
    return filled


def _variance(
    solution: GeometrySolution, name: str, pairs: Sequence[Pair], spread: Array, trust: float
) -> Map:
    """Variance [rad^2] of the shipped direction per node of a coarse grid over the panel.

    `spread` (h, w): of the measured field, NaN where nothing was measured: there it is the model's,
    and the misfit found elsewhere stays.
    """
    rig, layout = solution.rig, Layout.of(solution.rig)
    projector = rig.projectors[name]
    width, height = projector.size
    rows, columns = SIGMA_GRID, max(SIGMA_GRID, round(SIGMA_GRID * width / height))
    x, y = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    own = np.r_[layout.screen, layout.projectors[name]]
    modelled = _propagated(solution, own, lambda r: model_directions(r, r.projectors[name], nodes))
    points = land(rig.shape, np.zeros(3), model_directions(rig, projector, nodes))
    rays = [
        _propagated(solution, *_line_of_sight(rig, layout, camera, points)) for camera, _ in pairs
    ]
    ray = np.fmin.reduce(rays)
    cell = np.clip(((nodes + 0.5) / CELL_PX).astype(int), 0, np.array(spread.shape[::-1]) - 1)
    told = spread[cell[:, 1], cell[:, 0]]
    seen = np.isfinite(told) & np.isfinite(ray)
    measured = trust * (np.nan_to_num(ray) + np.nan_to_num(told)) + (1 - trust) * modelled
    left = trust * np.nanmean(spread) if seen.any() else 0.0
    return np.where(seen, measured, modelled + left).reshape(rows, columns).astype(np.float32)


def _line_of_sight(
    rig: Rig, layout: Layout, camera: str, points: Array
) -> tuple[NDArray[np.intp], Callable[[Rig], Array]]:
    """What a camera's view of points (N, 3) depends on, and the directions (N, 3) it tells."""
    model = rig.cameras[camera]
    assert model.camera_from_dome is not None
    pixels = project(model.camera_from_dome.apply(points), model.lens)
    return np.r_[layout.screen, layout.cameras[camera]], lambda r: normalise(
        points_seen(r, camera, pixels)
    )


def _propagated(
    solution: GeometrySolution, columns: NDArray[np.intp], told: Callable[[Rig], Array]
) -> Array:
    """Variance (N,) [rad^2] of directions (N, 3) that depend on some parameters; sum of both ways."""
    sigma = np.sqrt(np.diag(solution.covariance))
    used = columns[sigma[columns] > 0]
    slopes = []
    for i in used:
        step = np.zeros(len(sigma))
        step[i] = 0.1 * sigma[i]
        ahead, behind = told(solution.rig.moved(step)), told(solution.rig.moved(-step))
        slopes.append((ahead - behind) / (0.2 * sigma[i]))
    slope = np.stack(slopes, axis=-1)
    covariance = solution.covariance[np.ix_(used, used)]
    return np.asarray(np.einsum("nip,pq,niq->n", slope, covariance, slope))
