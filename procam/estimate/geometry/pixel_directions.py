"""Directions of a projector's pixels: measured where cameras saw them, modelled elsewhere."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from procam.estimate.geometry.model import (
    Observations,
    Pair,
    ParameterLayout,
    RigGeometry,
    points_seen,
    residuals,
)
from procam.estimate.geometry.screen_points import intersect_screen
from procam.estimate.geometry.solve import GeometrySolution
from procam.maths.geometry.lenses import project, unproject
from procam.maths.geometry.sphere import normalise
from procam.maths.warp import blur, blur_within, sample
from procam.model.optics import ProjectorModel

Array = NDArray[np.float64]
Map = NDArray[np.float32]
Look = Callable[[RigGeometry], Array]
CELL_PX = 16  # of the panel, over which what was measured is averaged
SMOOTH = 1.0  # cells
ROUGH = 3.0  # cells over which detail that was smoothed away is alike
BELIEVED = 0.5  # trust in the field, from which on what is left of detail is more than noise
FILL = (2.0, 6.0, 24.0)  # cells, ever wider, over which holes take their neighbours' error
REACHED = 0.02  # weight of what is known around a hole, from which on it is filled
SIGMA_GRID = 12  # nodes along the short edge at which standard errors are propagated
STEP = 1e-4  # of the radius, for slopes
FINE = 3  # places per cell of random fields: between them hardly any variance is lost
ARCMIN = np.degrees(1) * 60


@dataclass(frozen=True, slots=True)
class PixelDirections:
    """A projector's directions: those of its model plus a smooth field of what was measured.

    Attributes
    ----------
    field : (h, w, 3) on cells of `CELL_PX`. variance : (h', w') of the direction [rad^2], per node
        of a coarse grid over the panel. unknown : (h', w') the part of it that is the field's own.
    rays : (h', w') per camera, how much the direction follows its rays and not the model [-].
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
        """Standard error (len(y), len(x)) of the direction, both ways together [arcmin]."""
        where = self.nodes(np.stack(np.meshgrid(x, y), axis=-1).astype(float))
        return np.asarray(ARCMIN * np.sqrt(sample(self.variance, where)), np.float32)

    def nodes(self, pixels: Array) -> Array:
        """Places (..., 2) of the panel's points (..., 2) [px] among the nodes of the coarse grid."""
        rows, columns = self.variance.shape
        return pixels * ((np.array([columns, rows]) - 1) / (np.array(self.size) - 1))


def model_directions(rig: RigGeometry, projector: ProjectorModel, pixels: Array) -> Array:
    """Directions (..., 3) of projector pixels (..., 2) by the models alone; NaN if they miss."""
    back = projector.projector_from_dome.inverse()
    rays = back.rotate(unproject(pixels, projector.lens))
    return normalise(intersect_screen(rig.shape, back.translation, rays))


def fit_pixel_directions(solution: GeometrySolution, name: str) -> PixelDirections:
    """Directions of one projector from everything that cameras saw of it."""
    rig, projector = solution.rig, solution.rig.projectors[name]
    if name in solution.given:
        return _given(rig, projector, solution.given[name])
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
    return PixelDirections(
        rig,
        projector,
        _filled(np.float32(trust) * smooth, known),
        *_certainty(solution, name, list(views), np.where(known, spread, np.nan), trust),
    )


def _given(rig: RigGeometry, projector: ProjectorModel, sigma_arcmin: float) -> PixelDirections:
    """Directions that are known beforehand, as those of dome masters are."""
    variance = np.full((2, 2), (sigma_arcmin / ARCMIN) ** 2, np.float32)
    return PixelDirections(rig, projector, np.zeros((1, 1, 3), np.float32), variance, variance, {})


def sample_directions(
    solution: GeometrySolution, name: str, pixels: Array, count: int, rng: np.random.Generator
) -> Array:
    """Draws (count, ..., 3) of a projector's unit directions, as uncertain as they are told to be.

    Anything made of directions, such as solid angles, gets its error bar as the spread over draws.
    Each draw moves the whole rig by one step out of the solution's covariance. Pixels follow their
    model or, as far as they were measured, the rays of the camera that tells most; what the measured
    field does not know is added as a random one of its smoothness.

    Parameters
    ----------
    solution, name : a solved rig, and which of its projectors.
    pixels : (..., 2) points of the panel [px]; no side longer than 32766.
    count : how many draws. rng : where they come from: draws of another projector from the same
        state are of the same rigs, so that seams between them may be drawn too.

    Returns
    -------
    (count, ..., 3); NaN where a pixel misses the screen.
    """
    landing = fit_pixel_directions(solution, name)
    mean = landing.at(pixels).reshape(-1, 3)
    sources = _sources(landing, pixels, mean)
    still = _told(sources, solution.rig)
    spread = np.sqrt(sample(landing.unknown, landing.nodes(pixels)).reshape(-1, 1) / 2)
    drawn = np.empty((count, *mean.shape))
    for i, step in enumerate(_steps(solution.covariance, count, rng)):
        shift = _told(sources, solution.rig.moved(step)) - still
        drawn[i] = normalise(mean + shift + spread * _smooth_noise(landing.size, pixels, rng))
    return drawn.reshape(count, *pixels.shape[:-1], 3)


def _sources(landing: PixelDirections, pixels: Array, mean: Array) -> list[tuple[Array, Look]]:
    """What directions (N, 3) of pixels (..., 2) come from: shares (N, 1), and what each tells."""
    rig, flat, name = landing.rig, pixels.reshape(-1, 2), landing.projector.name
    points, nodes = intersect_screen(rig.shape, np.zeros(3), mean), landing.nodes(pixels)
    modelled, sources = np.ones((len(flat), 1)), []
    for camera, counts in landing.rays.items():
        if counts.any():
            look = _line_of_sight(rig, ParameterLayout.of(rig), camera, points)[1]
            sees = np.isfinite(look(rig)).all(axis=1, keepdims=True)
            share = np.where(sees, sample(counts, nodes).reshape(-1, 1), 0.0)
            modelled = modelled - share
            sources.append((share, look))
    return [(modelled, lambda r: model_directions(r, r.projectors[name], flat)), *sources]


def _told(sources: Sequence[tuple[Array, Look]], rig: RigGeometry) -> Array:
    """Directions (N, 3) that sources tell together, were the rig this one."""
    parts = [np.where(share > 0, share * look(rig), 0.0) for share, look in sources]
    return np.asarray(np.sum(parts, axis=0))


def _steps(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draws (count, P) of the rig's parameters from their covariance (P, P)."""
    sigma = np.sqrt(np.diag(covariance))
    scale = np.where(sigma > 0, sigma, 1.0)  # of turns, metres and pixels alike
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    half = vectors * np.sqrt(np.maximum(values, 0))
    return np.asarray(rng.standard_normal((count, len(sigma))) @ half.T * sigma)


def _smooth_noise(size: tuple[int, int], pixels: Array, rng: np.random.Generator) -> Array:
    """Random vectors (N, 3) of unit variance each way at pixels (..., 2), smooth over `SMOOTH` cells."""
    width, pitch = SMOOTH * FINE, CELL_PX / FINE
    margin = int(4 * width)  # blur mirrors at the border, where less would be averaged
    columns, rows = (int(n / pitch) + 2 + 2 * margin for n in size)
    white = rng.standard_normal((rows, columns, 3), np.float32)
    noise = blur(white, width) * np.sqrt(4 * np.pi) * width
    return np.asarray(sample(noise, (pixels + 0.5) / pitch + margin).reshape(-1, 3), float)


def _relief(rig: RigGeometry, seen: Mapping[Pair, Observations]) -> float:
    """How far the screen differs from its model, rms relative to the radius, as residuals tell."""
    steps = []
    shape = replace(rig.shape, radius_m=rig.shape.radius_m * (1 + STEP))
    higher = RigGeometry(shape, rig.cameras, rig.projectors)
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
    rig: RigGeometry, pair: Pair, seen: Observations, relief: float
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


def _certainty(
    solution: GeometrySolution, name: str, pairs: Sequence[Pair], spread: Array, trust: float
) -> tuple[Map, Map, dict[str, Map]]:
    """`variance`, `unknown` and `rays` of `PixelDirections`, per node of a coarse grid over the panel.

    `spread` (h, w): of the measured field, NaN where nothing was measured: there it is the model's,
    and the misfit found elsewhere stays.
    """
    grid = _grid(solution.projectors[name].size)
    cameras, nodes = [camera for camera, _ in pairs], grid.reshape(-1, 2)
    modelled, rays = _variances(solution, name, cameras, nodes)
    best, ray = rays.argmin(axis=0), rays.min(axis=0)
    cell = np.clip(((nodes + 0.5) / CELL_PX).astype(int), 0, np.array(spread.shape[::-1]) - 1)
    told = spread[cell[:, 1], cell[:, 0]]
    seen = np.isfinite(told) & np.isfinite(ray)
    left = trust * np.nanmean(spread) if seen.any() else 0.0
    share, unknown = trust * seen, np.where(seen, trust * told, left)
    variance = share * np.where(seen, ray, 0.0) + (1 - share) * modelled + unknown
    maps = [variance, unknown, *(share * (best == i) for i in range(len(cameras)))]
    first, second, *counts = (m.reshape(grid.shape[:2]).astype(np.float32) for m in maps)
    return first, second, dict(zip(cameras, counts, strict=True))


def _grid(size: tuple[int, int]) -> Array:
    """Nodes (h', w', 2) [px] over a panel, from its first pixel to its last."""
    width, height = size
    columns = max(SIGMA_GRID, round(SIGMA_GRID * width / height))
    x, y = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, SIGMA_GRID)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _variances(
    solution: GeometrySolution, name: str, cameras: Sequence[str], nodes: Array
) -> tuple[Array, Array]:
    """Variances [rad^2] of directions at nodes (N, 2): the model's (N,), and of each camera's rays (C, N).

    The latter are infinite where a camera does not see.
    """
    rig, layout = solution.rig, ParameterLayout.of(solution.rig)
    own = np.r_[layout.screen, layout.projectors[name]]
    modelled = _propagated(solution, own, lambda r: model_directions(r, r.projectors[name], nodes))
    points = intersect_screen(
        rig.shape, np.zeros(3), model_directions(rig, rig.projectors[name], nodes)
    )
    sights = (_line_of_sight(rig, layout, camera, points) for camera in cameras)
    rays = np.stack([_propagated(solution, *sight) for sight in sights])
    return modelled, np.nan_to_num(rays, nan=np.inf)


def _line_of_sight(
    rig: RigGeometry, layout: ParameterLayout, camera: str, points: Array
) -> tuple[NDArray[np.intp], Look]:
    """What a camera's view of points (N, 3) depends on, and the directions (N, 3) it tells."""
    model = rig.cameras[camera]
    assert model.camera_from_dome is not None
    pixels = project(model.camera_from_dome.apply(points), model.lens)
    return np.r_[layout.screen, layout.cameras[camera]], lambda r: normalise(
        points_seen(r, camera, pixels)
    )


def _propagated(solution: GeometrySolution, columns: NDArray[np.intp], told: Look) -> Array:
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
