"""Scattered light of a room that shares nothing with procam or its simulator, by random walks.

An exact sphere over a level deck with a dark wall and a round instrument, traced in closed form. Walks start
from a grid of receivers, whose light is then gathered once more with many rays. Lengths are in metres.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.stats import qmc

Array = NDArray[np.float64]
Index = NDArray[np.intp]
RADIUS, HALF_ANGLE = 5.0, np.radians(84.0)
DECK = -0.6  # height
POD, POD_RADIUS = np.array([1.2, 0.9, -0.45]), 0.5
DOME, WALL, DECK_FLOOR, INSTRUMENT = range(4)  # what rays meet
ALBEDOS = np.array([0.0, 0.05, 0.14, 0.3])  # of these; the dome has paint
RIM = RADIUS * np.cos(HALF_ANGLE)
WALL_RADIUS = RADIUS * np.sin(HALF_ANGLE)
ALBEDO, SMOOTH, SEAM, GRAIN = 0.52, 0.05, 0.06, 0.005
GORES, COURSES, SEAM_WIDTH = 20, 5, np.radians(0.35)
SENDERS, CUTS = (24, 72), 12  # patches of direct light, and places per edge of a patch
RECEIVERS = (14, 36)  # grid from pole to rim, where bounced light is known
PATCHES = SENDERS[0] * SENDERS[1]
ELSEWHERE = 240  # receivers on the deck, the wall and the instrument together
NEAREST = 1e-6  # rays do not meet where they start


def paint(direction: Array) -> Array:
    """Albedo (...,) of the dome: slow change, seams between panels, grain."""
    x, y, z = np.moveaxis(direction, -1, 0)
    polar, turn = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    albedo = ALBEDO * (1 + SMOOTH * (np.sin(2.3 * x + 0.5) * np.cos(1.7 * y) + 0.3 * z))
    across = _to_next(turn, 2 * np.pi / GORES) * np.sin(polar)
    along = _to_next(polar, HALF_ANGLE / COURSES)
    seams = np.exp(-0.5 * (across / SEAM_WIDTH) ** 2) + np.exp(-0.5 * (along / SEAM_WIDTH) ** 2)
    row, column = (polar / np.radians(0.5)).astype(int), (turn / np.radians(0.5)).astype(int)
    return np.asarray(
        albedo * (1 - SEAM * np.minimum(seams, 1)) * (1 + GRAIN * _noise(row, column))
    )


def _to_next(angle: Array, step: float) -> Array:
    return (angle / step - np.rint(angle / step)) * step


def _noise(row: Index, column: Index) -> Array:
    """About normal noise of places, the same whenever it is asked for."""
    mixed = (row.astype(np.uint64) * np.uint64(73856093)) ^ (
        column.astype(np.int64).view(np.uint64) * np.uint64(19349663)
    )
    mixed = (mixed * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    return (mixed / 2.0**24 - 0.5) * 12**0.5


def hit(origin: Array, direction: Array) -> tuple[Array, Index]:
    """Points (n, 3) that rays from inside the room meet first, and on what (n,)."""
    surfaces = (_to_dome, _to_wall, _to_deck, _to_pod)
    far = np.stack([distance(origin, direction) for distance in surfaces])
    far = np.where(far > NEAREST, far, np.inf)
    nearest = far.min(axis=0)
    step = np.where(np.isfinite(nearest), nearest, 0)[:, None] * direction
    return origin + step, np.argmin(far, axis=0)


def _to_dome(origin: Array, direction: Array) -> Array:
    along = np.sum(origin * direction, axis=-1)
    outside = np.sum(origin**2, axis=-1) - RADIUS**2
    far = -along + np.sqrt(np.maximum(along**2 - outside, 0))
    return np.where(origin[:, 2] + far * direction[:, 2] >= RIM, far, np.inf)


def _to_wall(origin: Array, direction: Array) -> Array:
    flat = np.sum(direction[:, :2] ** 2, axis=-1)
    along = np.sum(origin[:, :2] * direction[:, :2], axis=-1)
    outside = np.sum(origin[:, :2] ** 2, axis=-1) - WALL_RADIUS**2
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (-along + np.sqrt(np.maximum(along**2 - flat * outside, 0))) / flat
    return np.where(origin[:, 2] + far * direction[:, 2] < RIM, far, np.inf)


def _to_deck(origin: Array, direction: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(direction[:, 2] < 0, (DECK - origin[:, 2]) / direction[:, 2], np.inf)


def _to_pod(origin: Array, direction: Array) -> Array:
    away = origin - POD
    along = np.sum(away * direction, axis=-1)
    inside = along**2 - np.sum(away**2, axis=-1) + POD_RADIUS**2
    met = (inside > 0) & (along < 0)
    return np.where(met, -along - np.sqrt(np.maximum(inside, 0)), np.inf)


def albedo_at(points: Array, kind: Index) -> Array:
    """Albedo (n,) where rays have met the room."""
    albedo, on = ALBEDOS[kind], kind == DOME
    albedo[on] = paint(points[on] / RADIUS)
    return np.asarray(albedo)


def normals(points: Array, kind: Index) -> Array:
    """Normals (n, 3) into the room."""
    up = np.broadcast_to([0.0, 0, 1], points.shape)
    to_axis = -points * [1, 1, 0] / WALL_RADIUS
    return np.choose(kind[:, None], [-points / RADIUS, to_axis, up, (points - POD) / POD_RADIUS])


def scattered_rays(normal: Array, random: Array) -> Array:
    """Directions (n, 3) distributed as the cosine to the normal, of random numbers (n, 2)."""
    height, turn = 2 * random[:, 0] - 1, 2 * np.pi * random[:, 1]
    flat = np.sqrt(np.maximum(1 - height**2, 0))
    ball = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=-1)
    away = normal + ball * (1 - 1e-9)
    return np.asarray(away / np.linalg.norm(away, axis=-1, keepdims=True))


class Bounces:
    """Irradiance at receivers by radiosity of patches of the dome, after all bounces.

    `matrix` (receivers, patches); the first RECEIVERS of them are a grid on the dome.
    """

    def __init__(self, walks: int, rays: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self._points, self._kind = _receivers(rng)
        every = range(len(self._points))
        walked = np.stack([self._walked(receiver, walks, rng) for receiver in every])
        base = qmc.Sobol(2, rng=rng).random(rays)
        shifted = ((base + rng.random(2)) % 1.0 for _ in every)
        both = zip(every, shifted, strict=True)
        self.matrix = np.stack([self._gathered(receiver, r, walked) for receiver, r in both])

    def _gathered(self, receiver: int, random: Array, walked: Array) -> Array:
        """Row of the matrix: the patches that rays meet, and the light that receivers there have."""
        points, kind = self._leave(receiver, random)
        met = np.bincount(_patch(points[kind == DOME]), minlength=PATCHES)
        weight = np.bincount(self._nearest(points, kind), albedo_at(points, kind), len(walked))
        return np.asarray((met + weight @ walked) / len(random))

    def _walked(self, receiver: int, walks: int, rng: np.random.Generator) -> Array:
        """Row of the matrix by walks that end where the paint takes them."""
        points, kind = self._leave(receiver, rng.random((walks, 2)))
        met = np.zeros(PATCHES)
        while len(points):
            met += np.bincount(_patch(points[kind == DOME]), minlength=PATCHES)
            goes_on = rng.random(len(points)) < albedo_at(points, kind)
            points, kind = points[goes_on], kind[goes_on]
            away = scattered_rays(normals(points, kind), rng.random((len(points), 2)))
            points, kind = hit(points, away)
        return met / walks

    def _leave(self, receiver: int, random: Array) -> tuple[Array, Index]:
        point = np.repeat(self._points[receiver][None], len(random), axis=0)
        normal = normals(point, np.full(len(random), self._kind[receiver]))
        return hit(point, scattered_rays(normal, random))

    def _nearest(self, points: Array, kind: Index) -> Index:
        """The nearest receiver (n,) on the same surface."""
        chosen = _grid_node(points)
        for surface in (WALL, DECK_FLOOR, INSTRUMENT):
            here, use = np.flatnonzero(self._kind == surface), kind == surface
            away = np.linalg.norm(points[use][:, None] - self._points[here], axis=-1)
            chosen[use] = here[np.argmin(away, axis=1)]
        return chosen


def irradiance_at(points: Array, at_receivers: Array) -> Array:
    """Irradiance (n, C) at points (n, 3) on the dome, by a smooth curve through the receivers (R, C)."""
    grid = at_receivers[: RECEIVERS[0] * RECEIVERS[1]].reshape(*RECEIVERS, -1)
    grid = np.pad(grid, ((0, 0), (4, 4), (0, 0)), mode="wrap")
    row, column = _grid_place(points)
    place = [row, column + 4]
    planes = [
        map_coordinates(plane, place, order=3, mode="nearest") for plane in np.moveaxis(grid, -1, 0)
    ]
    return np.stack(planes, axis=-1)


def _receivers(rng: np.random.Generator) -> tuple[Array, Index]:
    """Points (n, 3) and what they are on: the grid on the dome, then elsewhere."""
    polar, turn = np.meshgrid(
        np.linspace(0, HALF_ANGLE, RECEIVERS[0]),
        2 * np.pi * np.arange(RECEIVERS[1]) / RECEIVERS[1],
        indexing="ij",
    )
    grid = RADIUS * np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], -1
    )
    third = ELSEWHERE // 3
    share, turn = rng.random(third), 2 * np.pi * rng.random(third)
    wall = np.stack(
        [WALL_RADIUS * np.cos(turn), WALL_RADIUS * np.sin(turn), DECK + share * (RIM - DECK)], -1
    )
    reach = WALL_RADIUS * np.sqrt(rng.random(third))
    deck = np.stack([reach * np.cos(turn), reach * np.sin(turn), np.full(third, DECK)], -1)
    ball = rng.normal(size=(third, 3))
    ball[:, 2] = np.maximum(ball[:, 2], (DECK - POD[2]) / POD_RADIUS * np.linalg.norm(ball, axis=1))
    pod = POD + POD_RADIUS * ball / np.linalg.norm(ball, axis=1, keepdims=True)
    kind = np.repeat(range(4), [RECEIVERS[0] * RECEIVERS[1], third, third, third])
    return np.concatenate([grid.reshape(-1, 3), wall, deck, pod]), kind


def _patch(points: Array) -> Index:
    """Patch (n,) of points on the dome: rings of equal area."""
    height = (1 - points[:, 2] / RADIUS) / (1 - np.cos(HALF_ANGLE))
    ring = np.clip((height * SENDERS[0]).astype(int), 0, SENDERS[0] - 1)
    sector = (np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) % 1 * SENDERS[1]).astype(int)
    return ring * SENDERS[1] + np.minimum(sector, SENDERS[1] - 1)


def _grid_place(points: Array) -> tuple[Array, Array]:
    """Row and column (...,) of points (..., 3) on the dome in the grid of receivers."""
    polar = np.arccos(np.clip(points[..., 2] / RADIUS, -1, 1))
    turn = np.arctan2(points[..., 1], points[..., 0]) / (2 * np.pi) % 1
    return polar / HALF_ANGLE * (RECEIVERS[0] - 1), turn * RECEIVERS[1]


def _grid_node(points: Array) -> Index:
    row, column = _grid_place(points)
    row = np.clip(np.rint(row).astype(int), 0, RECEIVERS[0] - 1)
    return np.asarray(row * RECEIVERS[1] + np.rint(column).astype(int) % RECEIVERS[1])


def patch_places() -> Array:
    """Points (patches, CUTS^2, 3) that share out every patch evenly."""
    share = (np.arange(SENDERS[0] * CUTS) + 0.5) / (SENDERS[0] * CUTS)
    cosine = 1 - share * (1 - np.cos(HALF_ANGLE))
    turn = 2 * np.pi * (np.arange(SENDERS[1] * CUTS) + 0.5) / (SENDERS[1] * CUTS)
    sine = np.sqrt(1 - cosine**2)[:, None]
    points = RADIUS * np.stack(
        [sine * np.cos(turn), sine * np.sin(turn), cosine[:, None] + 0 * turn], axis=-1
    )
    cut = points.reshape(SENDERS[0], CUTS, SENDERS[1], CUTS, 3).swapaxes(1, 2)
    return cut.reshape(PATCHES, CUTS**2, 3)
