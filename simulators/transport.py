"""Light between patches of the room by flux tracing: rays, hits and counts, no closed form.

Each patch sends cosine-distributed rays from stratified points; the share that hits another patch is the
form factor between them. Rays are intersected with the true dome, deck, wall and pod. All bounces follow from
the linear system E = F (b0 + rho E), solved once per room. The module is longer than 300 lines because every
surface has its points, its rays and its patches in one place.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from procam.arrays import Array, Array32, BoolArray, IndexArray
from procam.maths.geometry.sphere import angles_from_direction, normalise
from simulators.ends import Ends
from simulators.presets import Preset
from simulators.surface import Surface

DOME_RINGS, DOME_SECTORS = 30, 60
FLOOR_RINGS, FLOOR_SECTORS = 8, 24
WALL_RINGS, WALL_SECTORS = 3, 24
POD_RINGS, POD_SECTORS = 6, 12
POD_CENTRE_M = np.array([0.8, 1.0, -0.15])
POD_RADIUS_M = 0.55
POD_ALBEDO = 0.3
START_OFFSET_M = 1e-6
BATCH = 8  # patches cast together: few Python calls, and arrays that fit the cache


@dataclass(frozen=True)
class Deck:
    """The level floor under a tilted dome, and the round wall between them.

    `depth_m` is that of the floor below the sphere's centre; `radius_m` that of the disc that a level plane
    cuts out of the sphere at the wall's upper end, `wall_m` above the floor.
    """

    up: Array
    depth_m: float
    radius_m: float
    wall_m: float = 0.0

    @classmethod
    def under(cls, preset: Preset) -> "Deck":
        """The deck, `deck_drop_m` below the lowest point of the rim (or the springline, of shallow caps)."""
        tilt = np.radians(preset.tilt_deg)
        depth = preset.radius_m * np.sin(tilt)
        up = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
        radius = float(np.sqrt(preset.radius_m**2 - depth**2))
        return cls(up, float(depth + preset.deck_drop_m), radius, preset.deck_drop_m)

    def axes(self) -> tuple[Array, Array]:
        """Two unit vectors that span the deck."""
        left = np.array([0.0, 1.0, 0.0])
        return np.cross(left, self.up), left


@dataclass(frozen=True)
class Room:
    """Patches of the room and the light they exchange.

    Patches are ordered dome (rings of equal area from the pole), deck, wall, pod. `exchange` (P, P) holds the
    form factors: irradiance_i = sum_j exchange_ij radiosity_j. `area_m2`, `albedo` are (P,).
    """

    surface: Surface
    exchange: Array32
    area_m2: Array
    albedo: Array
    scatter: Array32  # (P, P) irradiance after all bounces per direct radiosity

    @classmethod
    def trace(cls, surface: Surface, rays: int = 2048) -> "Room":
        """Trace `rays` rays (a power of two) from every patch."""
        tracer = Tracer(surface)
        return cls.painted(surface, tracer.exchange(rays), tracer.area_m2, tracer.patch_albedo())

    @classmethod
    def painted(cls, surface: Surface, exchange: Array, area_m2: Array, albedo: Array) -> "Room":
        """A room of patches (P,) with form factors (P, P): solve for all bounces at once."""
        if surface.preset.bounces:
            # E = F (b0 + rho E)
            system = np.eye(len(albedo)) - exchange * albedo
            scatter = np.linalg.solve(system, exchange)
        else:
            scatter = np.zeros_like(exchange)
        return cls(
            surface, exchange.astype(np.float32), area_m2, albedo, scatter.astype(np.float32)
        )

    def repainted(self, surface: Surface) -> "Room":
        """The same room with the paint of `surface`; no ray is traced again."""
        before, after = self.surface.preset, surface.preset
        if _paint(before) == _paint(after):
            return replace(self, surface=surface)
        albedo, dome = self.albedo.copy(), DOME_RINGS * DOME_SECTORS
        centres = Tracer(surface).dome_centres()
        albedo[:dome] *= surface.relative_albedo(self.surface.preset, centres)
        floor = slice(dome, dome + FLOOR_RINGS * FLOOR_SECTORS)
        albedo[floor] += after.floor_albedo - before.floor_albedo
        return self.painted(surface, self.exchange.astype(float), self.area_m2, albedo)

    def irradiance(self, direct_flux: Array) -> Array:
        """Scattered irradiance (P, C) after all bounces from direct reflected flux (P, C)."""
        direct = (direct_flux / self.area_m2[:, None]).astype(np.float32)
        return np.asarray(self.scatter @ direct, dtype=float)

    def patch_image(self, patch_values: Array) -> Array32:
        """Values of the dome patches as an image (rings, sectors + 2, C), wrapped in azimuth."""
        count = DOME_RINGS * DOME_SECTORS
        image = patch_values[:count].reshape(DOME_RINGS, DOME_SECTORS, -1).astype(np.float32)
        return np.concatenate([image[:, -1:], image, image[:, :1]], axis=1)

    def dome_image_coordinates(self, direction: Array) -> Array32:
        """(column, row) in `patch_image` of unit directions (..., 3)."""
        azimuth, _ = angles_from_direction(direction)
        column = (azimuth / (2 * np.pi) % 1.0) * DOME_SECTORS + 0.5
        depth = (1 - direction[..., 2]) / (1 - np.cos(self.surface.half_angle))
        row = depth * DOME_RINGS - 0.5
        row = np.clip(row, 0, DOME_RINGS - 1)
        return np.stack([column, row], axis=-1).astype(np.float32)

    def ends(self, origin: Array, rays: Array) -> Ends:
        """Where lines of sight from `origin` (3,) [m] along unit `rays` (H, W, 3) end; NaN: nowhere."""
        surface, defined = self.surface, np.isfinite(rays[..., 0])
        rays = np.where(defined[..., None], rays, [0.0, 0.0, 1.0])
        point = surface.intersect(origin, rays)
        direction = normalise(point)
        on_dome = defined & (direction[..., 2] >= np.cos(surface.half_angle))
        direction = np.where(on_dome[..., None], direction, [0.0, 0.0, 1.0])
        return Ends(
            on_dome,
            np.where(on_dome[..., None], point, surface.preset.radius_m * direction),
            direction,
            np.where(on_dome, surface.albedo(direction), 0.0),
            self.dome_image_coordinates(direction),
            self._patches_below(origin, rays, defined & ~on_dome),
        )

    def _patches_below(
        self, origin: Array, rays: Array, beyond: BoolArray
    ) -> tuple[IndexArray, IndexArray]:
        place = np.flatnonzero(beyond)
        directions = rays.reshape(-1, 3)[place]
        patch, _ = Tracer(self.surface).cast_below(
            np.broadcast_to(origin, directions.shape), directions
        )
        return place[patch >= 0], patch[patch >= 0]


class Tracer:
    """The rays between patches."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self.deck = Deck.under(surface.preset)
        self.dome_count = DOME_RINGS * DOME_SECTORS
        self.floor_count = FLOOR_RINGS * FLOOR_SECTORS
        self.wall_count = WALL_RINGS * WALL_SECTORS if self.deck.wall_m else 0
        self.pod_count = POD_RINGS * POD_SECTORS if surface.preset.pod else 0
        self.before_pod = self.dome_count + self.floor_count + self.wall_count
        self.count = self.before_pod + self.pod_count
        self.area_m2 = self._areas()

    def dome_centres(self) -> Array:
        """Directions (D, 3) of the centres of the dome's patches."""
        middle = np.full((1, 2), 0.5)
        return np.concatenate([self._dome_direction(i, middle) for i in range(self.dome_count)])

    def patch_albedo(self) -> Array:
        """Mean albedo (P,) of the patches; the dome is sampled densely because of its seams."""
        samples = qmc.Sobol(2, rng=np.random.default_rng(5)).random(256)
        dome = [
            float(self.surface.albedo(self._dome_direction(i, samples)).mean())
            for i in range(self.dome_count)
        ]
        floor = np.full(self.floor_count, self.surface.preset.floor_albedo)
        wall = np.full(self.wall_count, self.surface.preset.wall_albedo)
        return np.concatenate([dome, floor, wall, np.full(self.pod_count, POD_ALBEDO)])

    def exchange(self, rays: int) -> Array:
        """(P, P) share of the rays of each row's patch that hit each column's patch."""
        base = qmc.Sobol(4, rng=np.random.default_rng(7)).random(rays)
        shifts = np.random.default_rng(11).random((self.count, 4))
        matrix = np.zeros((self.count, self.count))
        for first in range(0, self.count, BATCH):
            batch = range(first, min(first + BATCH, self.count))
            starts = [self._start(i, (base + shifts[i]) % 1.0) for i in batch]
            hit = self._cast(*(np.concatenate(part) for part in zip(*starts, strict=True)))
            for i, patch in zip(batch, hit.reshape(len(batch), rays), strict=True):
                matrix[i] = np.bincount(patch[patch >= 0], minlength=self.count) / rays
        return self._smooth_over_neighbours(matrix)

    def _smooth_over_neighbours(self, matrix: Array) -> Array:
        """Average each dome patch with its neighbours: irradiance is smooth, and the noise of rays is not."""
        dome = matrix[: self.dome_count].reshape(DOME_RINGS, DOME_SECTORS, self.count)
        for _ in range(2):
            dome = (np.roll(dome, 1, axis=1) + 2 * dome + np.roll(dome, -1, axis=1)) / 4
            padded = np.concatenate([dome[:1], dome, dome[-1:]])
            dome = (padded[:-2] + 2 * padded[1:-1] + padded[2:]) / 4
        matrix[: self.dome_count] = dome.reshape(self.dome_count, self.count)
        return matrix

    def _areas(self) -> Array:
        rise = 1 - np.cos(self.surface.half_angle)
        dome = 2 * np.pi * self.surface.preset.radius_m**2 * rise / self.dome_count
        rho = np.linspace(0, self.deck.radius_m, FLOOR_RINGS + 1)
        floor = np.pi * np.diff(rho**2)
        pod_ring = np.full(POD_RINGS, 4 * np.pi * POD_RADIUS_M**2 / POD_RINGS)
        parts = [np.full(self.dome_count, dome), np.repeat(floor / FLOOR_SECTORS, FLOOR_SECTORS)]
        if self.wall_count:
            wall = 2 * np.pi * self.deck.radius_m * self.deck.wall_m
            parts.append(np.full(self.wall_count, wall / self.wall_count))
        if self.pod_count:
            parts.append(np.repeat(pod_ring / POD_SECTORS, POD_SECTORS))
        return np.concatenate(parts)

    def _dome_direction(self, patch: int, uv: Array) -> Array:
        ring, sector = divmod(patch, DOME_SECTORS)
        z = 1 - (ring + uv[:, 0]) / DOME_RINGS * (1 - np.cos(self.surface.half_angle))
        azimuth = (sector + uv[:, 1]) / DOME_SECTORS * 2 * np.pi
        horizontal = np.sqrt(1 - z * z)
        return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), z], axis=-1)

    def _start(self, patch: int, sample: Array) -> tuple[Array, Array]:
        """Stratified points on a patch and cosine-distributed directions."""
        place, aim = sample[:, :2], sample[:, 2:]
        if patch < self.dome_count:
            direction = self._dome_direction(patch, place)
            normal = -direction
            point = direction * self.surface.radius(direction)[:, None]
        elif patch < self.dome_count + self.floor_count:
            point = self._floor_point(patch - self.dome_count, place)
            normal = np.broadcast_to(self.deck.up, point.shape)
        elif patch < self.before_pod:
            point, normal = self._wall_point(patch - self.dome_count - self.floor_count, place)
        else:
            normal = _pod_normal(patch - self.before_pod, place)
            point = POD_CENTRE_M + POD_RADIUS_M * normal
        return point + START_OFFSET_M * normal, cosine_directions(normal, aim)

    def _floor_point(self, patch: int, uv: Array) -> Array:
        ring, sector = divmod(patch, FLOOR_SECTORS)
        edge = (np.array([ring, ring + 1]) / FLOOR_RINGS * self.deck.radius_m) ** 2
        rho = np.sqrt(edge[0] + (edge[1] - edge[0]) * uv[:, 0])
        angle = (sector + uv[:, 1]) / FLOOR_SECTORS * 2 * np.pi
        first, second = self.deck.axes()
        plane = (rho * np.cos(angle))[:, None] * first + (rho * np.sin(angle))[:, None] * second
        return np.asarray(plane - self.deck.depth_m * self.deck.up)

    def _wall_point(self, patch: int, uv: Array) -> tuple[Array, Array]:
        """Points (n, 3) [m] on a patch of the wall, and its normals (n, 3)."""
        ring, sector = divmod(patch, WALL_SECTORS)
        height = (ring + uv[:, :1]) / WALL_RINGS * self.deck.wall_m - self.deck.depth_m
        angle = (sector + uv[:, 1:]) / WALL_SECTORS * 2 * np.pi
        first, second = self.deck.axes()
        outwards = np.cos(angle) * first + np.sin(angle) * second
        return self.deck.radius_m * outwards + height * self.deck.up, -outwards

    def _cast(self, origin: Array, direction: Array) -> IndexArray:
        """Patch that each ray hits first; -1 where it leaves the room."""
        point = self.surface.intersect(origin, direction)
        met = np.isfinite(point).all(
            axis=-1, keepdims=True
        )  # the wall's foot is outside the sphere
        unit = np.where(
            met, point / np.linalg.norm(point, axis=-1, keepdims=True), [0.0, 0.0, -1.0]
        )
        on_cap = unit[:, 2] >= np.cos(self.surface.half_angle)
        hit = np.where(on_cap, dome_patch(unit, self.surface.half_angle), -1)
        distance = np.where(on_cap, np.linalg.norm(point - origin, axis=-1), np.inf)
        below, reach = self.cast_below(origin, direction)
        return np.where(reach < distance, below, hit)

    def cast_below(self, origin: Array, direction: Array) -> tuple[IndexArray, Array]:
        """Patch of deck, wall or pod that each ray (n, 3) hits first, -1 for none, and how far it is [m]."""
        hit, distance = self._cast_floor(origin, direction)
        for caster, count in (self._cast_wall, self.wall_count), (self._cast_pod, self.pod_count):
            if count:
                other, reach = caster(origin, direction)
                nearer = reach < distance
                hit, distance = np.where(nearer, other, hit), np.where(nearer, reach, distance)
        return np.where(np.isfinite(distance), hit, -1), distance

    def _cast_floor(self, origin: Array, direction: Array) -> tuple[IndexArray, Array]:
        speed = direction @ self.deck.up
        height = origin @ self.deck.up + self.deck.depth_m
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(speed < 0, -height / speed, np.inf)
        reach = np.where(reach > START_OFFSET_M, reach, np.inf)
        point = origin + np.where(np.isfinite(reach), reach, 0.0)[:, None] * direction
        inside = np.linalg.norm(point + self.deck.depth_m * self.deck.up, axis=-1)
        reach = np.where(inside <= self.deck.radius_m, reach, np.inf)
        return _floor_patch(point, self.deck), reach

    def _cast_wall(self, origin: Array, direction: Array) -> tuple[IndexArray, Array]:
        up, axes = self.deck.up, np.stack(self.deck.axes(), axis=1)
        start, step = origin @ axes, direction @ axes
        speed = np.maximum(np.sum(step**2, axis=1), 1e-30)
        along = np.sum(start * step, axis=1) / speed
        square = along**2 - (np.sum(start**2, axis=1) - self.deck.radius_m**2) / speed
        reach = np.sqrt(np.maximum(square, 0)) - along
        height = (origin + reach[:, None] * direction) @ up + self.deck.depth_m
        met = (square > 0) & (reach > START_OFFSET_M) & (height >= 0) & (height <= self.deck.wall_m)
        ring = np.clip(height / self.deck.wall_m * WALL_RINGS, 0, WALL_RINGS - 1).astype(np.intp)
        end = start + reach[:, None] * step
        sector = _sector(end[:, 0], end[:, 1], WALL_SECTORS)
        patch = self.dome_count + self.floor_count + ring * WALL_SECTORS + sector
        return patch, np.where(met, reach, np.inf)

    def _cast_pod(self, origin: Array, direction: Array) -> tuple[IndexArray, Array]:
        offset = origin - POD_CENTRE_M
        along = np.sum(offset * direction, axis=-1)
        discriminant = along**2 - np.sum(offset**2, axis=-1) + POD_RADIUS_M**2
        reach = -along - np.sqrt(np.maximum(discriminant, 0))
        reach = np.where((discriminant > 0) & (reach > 2 * START_OFFSET_M), reach, np.inf)
        normal = offset + np.where(np.isfinite(reach), reach, 0.0)[:, None] * direction
        return self.before_pod + _pod_patch(normal / POD_RADIUS_M), reach


def _paint(preset: Preset) -> tuple[object, ...]:
    """All that a change of paint can change about the inter-reflection."""
    return preset.albedo, preset.bounces, preset.floor_albedo, preset.dirt, preset.stains


def cosine_directions(normal: Array, aim: Array) -> Array:
    """Directions (N, 3) about `normal` (N, 3) with density cos/pi."""
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(normal, first)
    radius, angle = np.sqrt(aim[:, :1]), 2 * np.pi * aim[:, 1:]
    up = np.sqrt(1 - aim[:, :1])
    return np.asarray(radius * (np.cos(angle) * first + np.sin(angle) * second) + up * normal)


def dome_patch(direction: Array, half_angle: float) -> IndexArray:
    """Patch index (...) of unit directions that lie on the dome."""
    azimuth, _ = angles_from_direction(direction)
    depth = (1 - direction[..., 2]) / (1 - np.cos(half_angle))
    ring = np.clip(depth * DOME_RINGS, 0, DOME_RINGS - 1)
    sector = np.minimum((azimuth / (2 * np.pi) % 1.0) * DOME_SECTORS, DOME_SECTORS - 1)
    return ring.astype(np.intp) * DOME_SECTORS + sector.astype(np.intp)


def _floor_patch(point: Array, deck: Deck) -> IndexArray:
    first, second = deck.axes()
    u, v = point @ first, point @ second
    ring = np.clip(np.hypot(u, v) / deck.radius_m * FLOOR_RINGS, 0, FLOOR_RINGS - 1)
    return (
        DOME_RINGS * DOME_SECTORS
        + ring.astype(np.intp) * FLOOR_SECTORS
        + _sector(u, v, FLOOR_SECTORS)
    )


def _sector(x: Array, y: Array, sectors: int) -> IndexArray:
    """Sector (...) of a circle in which (x, y) lies."""
    turn = np.arctan2(y, x) / (2 * np.pi) % 1.0
    return np.minimum((turn * sectors).astype(np.intp), sectors - 1)


def _pod_normal(patch: int, uv: Array) -> Array:
    ring, sector = divmod(patch, POD_SECTORS)
    z = 1 - 2 * (ring + uv[:, 0]) / POD_RINGS
    azimuth = (sector + uv[:, 1]) / POD_SECTORS * 2 * np.pi
    horizontal = np.sqrt(1 - z * z)
    return np.stack([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), z], axis=-1)


def _pod_patch(normal: Array) -> IndexArray:
    ring = np.clip((1 - normal[..., 2]) / 2 * POD_RINGS, 0, POD_RINGS - 1).astype(np.intp)
    azimuth = np.arctan2(normal[..., 1], normal[..., 0]) / (2 * np.pi) % 1.0
    return ring * POD_SECTORS + np.minimum(azimuth * POD_SECTORS, POD_SECTORS - 1).astype(np.intp)
