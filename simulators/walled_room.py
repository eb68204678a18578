"""Rooms of walls: paint, patches, and the light that they exchange, by casting rays.

A wall is a grid of patches. Each patch sends cosine-distributed rays from stratified points, as in
`transport`; nothing here knows of triangles or form factors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from procam.arrays import Array, Array32, BoolArray, FloatArray, IndexArray
from procam.maths.geometry.lenses import unproject
from simulators.builds import ProjectorBuild
from simulators.ends import Ends, LitPixels
from simulators.presets import Preset
from simulators.solid_angles import grid_solid_angles
from simulators.transport import BATCH, START_OFFSET_M, Room, cosine_directions
from simulators.walls import Wall

SEAM_EVERY_M, SEAM_SIGMA_M = 1.5, 0.025  # of panels on lit walls
WAVES = ((1.0, 0.4, 0.3), (0.6, -1.1, 1.7))  # of the paint: cycles along u and v, and phase [rad]
FEWEST = 2  # patches along an edge of a wall: light is linear between their centres
CLEAR_M = 1e-6  # by which a ray may end before the point it is cast at


class Cast(NamedTuple):
    """Where rays (N) meet walls: number of the wall (-1 for none), distance [m], position on it."""

    wall: IndexArray
    distance: Array
    u: Array
    v: Array


@dataclass(frozen=True)
class WalledSurface:
    """Walls and their paint.

    Attributes
    ----------
    lit : names of the walls that projectors light, painted with the preset's albedo. others : albedo of
        the rest by name. patch_m : edge of a patch, about.
    """

    preset: Preset
    walls: tuple[Wall, ...]
    lit: frozenset[str]
    others: Mapping[str, float]
    patch_m: float

    @cached_property
    def grids(self) -> list[tuple[int, int, int]]:
        """Columns and rows of each wall's patches, and the number of its first."""
        found, first = list[tuple[int, int, int]](), 0
        for wall in self.walls:
            columns, rows = (max(FEWEST, round(size / self.patch_m)) for size in wall.size_m)
            found.append((columns, rows, first))
            first += columns * rows
        return found

    def cast(self, origin: Array, direction: Array) -> Cast:
        """The first walls that rays (N, 3) meet."""
        found = Cast(
            np.full(len(direction), -1),
            np.full(len(direction), np.inf),
            *np.zeros((2, len(direction))),
        )
        origin = np.broadcast_to(origin, direction.shape)
        for number, wall in enumerate(self.walls):
            distance, u, v = wall.hit(origin, direction)
            nearer = distance < found.distance
            for array, values in zip(found, (number, distance, u, v), strict=True):
                array[nearer] = values if np.isscalar(values) else values[nearer]  # type: ignore[index]
        return found

    def sees(self, origin: Array, points: Array) -> BoolArray:
        """Whether nothing is between an origin (3,) and points (..., 3) of walls."""
        away = (points - origin).reshape(-1, 3)
        distance = np.linalg.norm(away, axis=1)
        met = self.cast(origin, away / distance[:, None]).distance
        return np.asarray(met > distance * (1 - 1e-6) - CLEAR_M).reshape(points.shape[:-1])

    def albedo(self, cast: Cast) -> Array:
        """Diffuse reflectance (N,) where rays end; 0 where they end nowhere."""
        found = np.zeros(len(cast.wall))
        for number, wall in enumerate(self.walls):
            here = cast.wall == number
            if wall.name not in self.lit:
                found[here] = self.others.get(wall.name, 0.0)
            elif here.any():
                found[here] = self._painted(wall, cast.u[here], cast.v[here])
        return found

    def _painted(self, wall: Wall, u: Array, v: Array) -> Array:
        preset = self.preset
        waves = [np.sin(2 * np.pi * (a * u + b * v) + phase) for a, b, phase in WAVES]
        slow = 1 + preset.albedo_smooth * np.mean(waves, axis=0)
        across = np.abs((u * wall.size_m[0] / SEAM_EVERY_M) % 1 - 0.5) * SEAM_EVERY_M / SEAM_SIGMA_M
        return np.asarray(preset.albedo * slow * (1 - preset.seam * np.exp(-0.5 * across**2)))

    def relative_albedo(self, other: Preset, points: Array) -> Array:
        """Albedo (...) of lit walls over that of another paint, which may differ in its mean alone."""
        return np.full(points.shape[:-1], self.preset.albedo / other.albedo)

    def patch(self, cast: Cast) -> IndexArray:
        """Number (N,) of the patch where rays end, -1 for none."""
        found = np.full(len(cast.wall), -1)
        for number, (columns, rows, first) in enumerate(self.grids):
            here = cast.wall == number
            column = np.clip(cast.u[here] * columns, 0, columns - 1).astype(np.intp)
            row = np.clip(cast.v[here] * rows, 0, rows - 1).astype(np.intp)
            found[here] = first + row * columns + column
        return found

    def inwards(self, cast: Cast, points: Array) -> Array:
        """Unit normals (N, 3) where rays end, z up where they end nowhere."""
        found = np.broadcast_to(np.array([0.0, 0.0, 1.0]), points.shape).copy()
        for number, wall in enumerate(self.walls):
            here = cast.wall == number
            found[here] = wall.inwards(points[here])
        return found

    def lit_pixels(self, build: ProjectorBuild) -> LitPixels:
        """Where a projector's pixels land: their light ends at walls that are not lit."""
        width, height = build.size
        back = build.projector_from_dome.inverse()

        def rays(x: FloatArray, y: FloatArray) -> Array:
            pixels = np.stack(np.meshgrid(x, y), axis=-1)
            return np.asarray(back.rotate(unproject(pixels.astype(float), build.lens)))

        centre = rays(np.arange(width, dtype=float), np.arange(height, dtype=float))
        corner = rays(np.arange(width + 1) - 0.5, np.arange(height + 1) - 0.5)
        flat = centre.reshape(-1, 3)
        cast = self.cast(back.translation, flat)
        reach = np.where(cast.wall >= 0, cast.distance, 1.0)
        points = back.translation + reach[:, None] * flat
        cosine = -np.einsum("ni,ni->n", self.inwards(cast, points), flat)
        on_lit = np.isin(cast.wall, [i for i, w in enumerate(self.walls) if w.name in self.lit])
        area = grid_solid_angles(corner).ravel() * reach**2 / np.maximum(cosine, 1e-3)
        shape = (height, width)
        return LitPixels(
            points.reshape(*shape, 3),
            area.reshape(shape),
            area.reshape(shape),
            on_lit.reshape(shape),
            np.maximum(self.patch(cast), 0).reshape(shape),
            self.albedo(cast).reshape(shape),
        )


@dataclass(frozen=True)
class WalledRoom(Room):
    """Patches of walls and the light they exchange, in the order of `WalledSurface.grids`."""

    surface: WalledSurface  # type: ignore[assignment]

    @classmethod
    def trace(cls, surface: WalledSurface, rays: int = 2048) -> "WalledRoom":  # type: ignore[override]
        """Trace `rays` rays (a power of two) from every patch."""
        areas = [
            wall.cell_areas(columns, rows).ravel()
            for wall, (columns, rows, _) in zip(surface.walls, surface.grids, strict=True)
        ]
        area, albedo = np.concatenate(areas), patch_albedo(surface)
        return cls.painted(surface, _exchange(surface, rays), area, albedo)  # type: ignore[return-value,arg-type]

    def repainted(self, surface: WalledSurface) -> "WalledRoom":  # type: ignore[override]
        """The same room with the paint of `surface`."""
        before, after = self.surface.preset, surface.preset
        if (before.albedo, before.bounces) == (after.albedo, after.bounces):
            return replace(self, surface=surface)
        exchange = self.exchange.astype(float)
        return self.painted(surface, exchange, self.area_m2, patch_albedo(surface))  # type: ignore[return-value,arg-type]

    def patch_image(self, patch_values: Array) -> Array32:
        """Values (P, C) as an image: the walls one below the other, each with a border that continues it."""
        grids = self.surface.grids
        wide = max(columns for columns, _, _ in grids) + 2
        blocks = []
        for columns, rows, first in grids:
            values = patch_values[first : first + columns * rows].reshape(rows, columns, -1)
            for axis in (0, 1):
                values = _continued(values, axis)
            blocks.append(np.pad(values, ((0, 0), (0, wide - columns - 2), (0, 0))))
        return np.concatenate(blocks).astype(np.float32)

    def ends(self, origin: Array, rays: Array) -> Ends:
        """Where lines of sight end."""
        flat, shape = rays.reshape(-1, 3), rays.shape[:-1]
        surface = self.surface
        cast = surface.cast(origin, flat)
        points = origin + np.where(np.isfinite(cast.distance), cast.distance, 1.0)[:, None] * flat
        nothing = np.empty(0, np.intp)
        return Ends(
            (cast.wall >= 0).reshape(shape),
            points.reshape(rays.shape),
            -surface.inwards(cast, points).reshape(rays.shape),
            surface.albedo(cast).reshape(shape),
            self._image_coordinates(cast).reshape(*shape, 2),
            (nothing, nothing),
        )

    def _image_coordinates(self, cast: Cast) -> Array32:
        """(column, row) in `patch_image` where rays end."""
        found, top = np.zeros((len(cast.wall), 2)), 0
        for number, (columns, rows, _) in enumerate(self.surface.grids):
            here = cast.wall == number
            found[here, 0] = cast.u[here] * columns + 0.5
            found[here, 1] = cast.v[here] * rows + 0.5 + top
            top += rows + 2
        return found.astype(np.float32)


def patch_albedo(surface: WalledSurface) -> Array:
    """Mean albedo (P,) of the patches."""
    samples = qmc.Sobol(2, rng=np.random.default_rng(5)).random(64)
    found = []
    for number, (columns, rows, _) in enumerate(surface.grids):
        for u, v in _patch_positions(columns, rows, samples):
            cast = Cast(np.full(len(u), number), np.zeros(len(u)), u, v)
            found.append(float(surface.albedo(cast).mean()))
    return np.array(found)


def _patch_positions(columns: int, rows: int, samples: Array) -> Sequence[tuple[Array, Array]]:
    return [
        ((column + samples[:, 0]) / columns, (row + samples[:, 1]) / rows)
        for row in range(rows)
        for column in range(columns)
    ]


def _exchange(surface: WalledSurface, rays: int) -> Array:
    """(P, P) share of the rays of each row's patch that hit each column's patch."""
    columns, rows, first = surface.grids[-1]
    count = first + columns * rows
    base = qmc.Sobol(4, rng=np.random.default_rng(7)).random(rays)
    shifts = np.random.default_rng(11).random((count, 4))
    matrix, starts = np.zeros((count, count)), []
    for wall, (columns, rows, first) in zip(surface.walls, surface.grids, strict=True):
        for patch in range(first, first + columns * rows):
            starts.append(_start(wall, (columns, rows), patch - first, (base + shifts[patch]) % 1))
            if len(starts) == BATCH or patch == count - 1:
                origin, direction = (np.concatenate(part) for part in zip(*starts, strict=True))
                hit = surface.patch(surface.cast(origin, direction))
                for back, seen in enumerate(hit.reshape(len(starts), rays)[::-1]):
                    counted = np.bincount(seen[seen >= 0], minlength=count)
                    matrix[patch - back] = counted / rays
                starts = []
    return matrix


def _start(wall: Wall, grid: tuple[int, int], patch: int, sample: Array) -> tuple[Array, Array]:
    """Stratified points on a patch and cosine-distributed directions."""
    (columns, rows), (row, column) = grid, divmod(patch, grid[0])
    u, v = (column + sample[:, 0]) / columns, (row + _by_area(wall, rows, row, sample[:, 1])) / rows
    points = wall.points(u, v)
    normal = wall.inwards(points)
    return points + START_OFFSET_M * normal, cosine_directions(normal, sample[:, 2:])


def _by_area(wall: Wall, rows: int, row: int, share: Array) -> Array:
    """Positions within a row of patches, 0..1, that are uniform over its area."""
    edges = np.cumsum(np.r_[0.0, wall.cell_areas(1, 64 * rows)[:, 0]])[
        64 * row : 64 * (row + 1) + 1
    ]
    return np.interp(share, (edges - edges[0]) / (edges[-1] - edges[0]), np.linspace(0, 1, 65))


def _continued(values: Array, axis: int) -> Array:
    """Values with a border along an axis that continues them linearly."""
    values = np.moveaxis(values, axis, 0)
    low, high = 2 * values[:1] - values[1:2], 2 * values[-1:] - values[-2:-1]
    return np.moveaxis(np.concatenate([low, values, high]), 0, axis)
