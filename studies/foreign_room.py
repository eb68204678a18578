"""A dome that shares nothing with procam or its simulator: rays, paint, projectors, camera and bounces.

An exact sphere over a level deck with a dark wall and a round instrument. Everything is traced in closed form
with NumPy: camera pixels by nine rays each, bounces by random walks from a grid of receivers, whose light is
then gathered once more with many rays. Lengths are in metres, light in camera full scale per second.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_array
from scipy.stats import qmc

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Index = NDArray[np.intp]
RADIUS, HALF_ANGLE = 5.0, np.radians(84.0)
PLATES = np.radians(82.0)  # no light beyond this polar angle
DECK, DECK_ALBEDO, WALL_ALBEDO = -0.6, 0.14, 0.05
POD, POD_RADIUS, POD_ALBEDO = np.array([1.2, 0.9, -0.45]), 0.5, 0.3
RIM = RADIUS * np.cos(HALF_ANGLE)
WALL_RADIUS = RADIUS * np.sin(HALF_ANGLE)
ALBEDO, SMOOTH, SEAM, GRAIN = 0.52, 0.05, 0.06, 0.005
GORES, COURSES, SEAM_WIDTH = 20, 5, np.radians(0.35)
SENDERS, CUTS = (24, 72), 12  # patches of direct light, and places per edge of a patch
RECEIVERS = (14, 36)  # grid from pole to rim, where bounced light is known
ELSEWHERE = 240  # receivers on the deck, the wall and the instrument together
DARK = 1e-9


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


@dataclass(frozen=True)
class Projector:
    """A projector on the rim: `place` (3,), `rotation` (3, 3) with rows right, down and ahead."""

    size: tuple[int, int]
    place: Array
    rotation: Array
    white: Array  # (3, 3) light in the camera's channels per primary
    gamma: Array

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return 0.58 * self.size[0]

    @property
    def centre(self) -> Array:
        """Principal point: the picture is shifted upwards."""
        return np.array([0.503, 0.56]) * self.size

    def pixels(self, points: Array) -> Array:
        """Pixels (..., 2) of points (..., 3); NaN behind the lens."""
        local = (points - self.place) @ self.rotation.T
        with np.errstate(invalid="ignore", divide="ignore"):
            flat = np.where(local[..., 2:] > 0.1 * RADIUS, local[..., :2] / local[..., 2:], np.nan)
        return np.asarray(self.focal_px * flat * _barrel(flat) + self.centre)

    def rays(self, pixel: Array) -> Array:
        """Unit rays (..., 3) of pixels (..., 2)."""
        wanted = (pixel - self.centre) / self.focal_px
        flat = wanted
        for _ in range(30):
            flat = wanted / _barrel(flat)
        local = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
        return local / np.linalg.norm(local, axis=-1, keepdims=True) @ self.rotation

    def light(self, points: Array, pixel: Array) -> Array:
        """Irradiance (...,) on the dome at points (..., 3) by a white picture, seen in green."""
        away = points - self.place
        distance = np.linalg.norm(away, axis=-1)
        incidence = np.sum(away * points, axis=-1) / (distance * RADIUS)
        corner = np.linalg.norm(pixel - np.array(self.size) / 2, axis=-1) / np.linalg.norm(
            self.size
        )
        inside = points[..., 2] > RADIUS * np.cos(PLATES)
        return np.asarray(90.0 * inside * (1 - 0.8 * corner**2) * incidence / distance**2)

    def sent(self, drive: Image) -> Image:
        """Light (H, W, 3) of the panel in camera channels for a drive in 0..1: 1 is white in green."""
        code = np.rint(np.clip(drive, 0, 1) * 255) / 255  # an 8 bit input
        light = ((code + 0.03) ** self.gamma - 0.03**self.gamma) / (
            1.03**self.gamma - 0.03**self.gamma
        )
        mixed = light @ self.white.T + self.white.sum(axis=1) / 1600  # black
        return cv2.GaussianBlur(mixed.astype(np.float32), (0, 0), 0.7)


def _barrel(flat: Array) -> Array:
    """Distortion (..., 1) of a projector's lens, which is no polynomial."""
    radius2 = np.sum(flat**2, axis=-1, keepdims=True)
    return np.asarray(1 - 0.03 * radius2 / (1 + 0.2 * radius2))


def make_projectors(size: tuple[int, int]) -> dict[str, Projector]:
    """Three projectors round the rim, each pointed at the far side."""
    made = {}
    for number, name in enumerate(("front", "left", "right")):
        turn = 2 * np.pi * number / 3 + 0.07 * number
        place = np.array([-4.5 * np.cos(turn), -4.5 * np.sin(turn), 0.42 + 0.02 * number])
        rise, pan = np.radians(33.0 + number), turn + 0.02 * (number - 1)
        ahead = np.array([np.cos(pan) * np.cos(rise), np.sin(pan) * np.cos(rise), np.sin(rise)])
        right = np.cross(ahead, [0.02 * (1 - number), 0.01, 1.0])
        right /= np.linalg.norm(right)
        mix = np.array([[0.92, 0.05, 0.01], [0.04, 0.93, 0.05], [0.01, 0.06, 0.88]])
        mix = mix * (1 + 0.03 * np.sin(np.arange(9).reshape(3, 3) + number))
        rotation = np.stack([right, np.cross(ahead, right), ahead])
        gamma = np.array([2.3, 2.35, 2.25]) + 0.03 * number
        made[name] = Projector(size, place, rotation, mix, gamma)
    return made


@dataclass(frozen=True)
class Camera:
    """An equisolid fisheye on the deck, looking up, whose optics are a little oblique."""

    size: int
    place: Array
    rotation: Array  # (3, 3) rows right, down and ahead
    prism: tuple[float, float] = (0.02, -0.015)  # [px] at the edge
    reach: float = np.radians(92.0)

    @property
    def focal_px(self) -> float:
        """Focal length."""
        return 0.49 * self.size / (2 * np.sin(self.reach / 2))

    @property
    def centre(self) -> Array:
        """Principal point."""
        return np.array([(self.size - 1) / 2 + 2.6, (self.size - 1) / 2 - 1.7])

    def rays(self, pixel: Array) -> Array:
        """Unit rays (..., 3) of pixels (..., 2); NaN outside the circle."""
        away = pixel - self.centre
        edge = 0.49 * self.size
        away = away - np.array(self.prism) * np.sum(away**2, axis=-1, keepdims=True) / edge**2
        radius = np.linalg.norm(away, axis=-1)
        with np.errstate(invalid="ignore"):
            polar = 2 * np.arcsin(np.where(radius <= edge, radius / (2 * self.focal_px), np.nan))
        across = away * (np.sin(polar) / np.maximum(radius, DARK))[..., None]
        return np.concatenate([across, np.cos(polar)[..., None]], axis=-1) @ self.rotation

    def pixel_of(self, point: Array) -> Array:
        """Pixel (2,) of a point (3,)."""
        local = self.rotation @ (point - self.place)
        polar = np.arctan2(np.hypot(*local[:2]), local[2])
        flat = 2 * self.focal_px * np.sin(polar / 2) * local[:2] / max(np.hypot(*local[:2]), DARK)
        return flat + np.array(self.prism) * np.sum(flat**2) / (0.49 * self.size) ** 2 + self.centre


def make_camera(size: int) -> Camera:
    """The camera, tilted and turned a little."""
    ahead = np.array([0.05, -0.04, 1.0]) / np.linalg.norm([0.05, -0.04, 1.0])
    right = np.cross([0.9, 0.3, 0.0], ahead)
    right /= np.linalg.norm(right)
    return Camera(
        size, np.array([0.25, -0.35, 0.1]), np.stack([right, np.cross(ahead, right), ahead])
    )


def hit(origin: Array, direction: Array) -> tuple[Array, Index]:
    """Points (n, 3) that rays meet first, and on what: 0 dome, 1 wall, 2 deck, 3 instrument; -1 nothing."""
    x, y, z = origin.T
    along, outside = np.sum(origin * direction, -1), np.sum(origin**2, -1) - RADIUS**2
    dome = -along + np.sqrt(np.maximum(along**2 - outside, 0))
    flat = direction[:, 0] ** 2 + direction[:, 1] ** 2
    half = x * direction[:, 0] + y * direction[:, 1]
    out = x**2 + y**2 - WALL_RADIUS**2
    with np.errstate(divide="ignore", invalid="ignore"):
        wall = (-half + np.sqrt(np.maximum(half**2 - flat * out, 0))) / flat
        deck = np.where(direction[:, 2] < 0, (DECK - z) / direction[:, 2], np.inf)
    from_pod = origin - POD
    near = np.sum(from_pod * direction, -1)
    inside = near**2 - np.sum(from_pod**2, -1) + POD_RADIUS**2
    pod = np.where((inside > 0) & (near < 0), -near - np.sqrt(np.maximum(inside, 0)), np.inf)
    dome = np.where((dome > 1e-6) & (z + dome * direction[:, 2] >= RIM), dome, np.inf)
    wall = np.where((wall > 1e-6) & (z + wall * direction[:, 2] < RIM), wall, np.inf)
    far = np.stack(
        [dome, wall, np.where(deck > 1e-6, deck, np.inf), np.where(pod > 1e-6, pod, np.inf)]
    )
    kind = np.argmin(far, axis=0)
    nearest = far[kind, np.arange(len(x))]
    return origin + np.where(np.isfinite(nearest), nearest, 0)[:, None] * direction, np.where(
        np.isfinite(nearest), kind, -1
    )


def normals(points: Array, kind: Index) -> Array:
    """Normals (n, 3) into the room."""
    to_axis = -points * [1, 1, 0] / WALL_RADIUS
    choices = [
        -points / RADIUS,
        to_axis,
        np.broadcast_to([0.0, 0, 1], points.shape),
        (points - POD) / POD_RADIUS,
    ]
    return np.choose(np.clip(kind, 0, 3)[:, None], choices)


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
        count, patches = len(self._points), SENDERS[0] * SENDERS[1]
        walked = np.zeros((count, patches))
        for first in range(count):
            walked[first] = self._walked(first, walks, rng)
        base = qmc.Sobol(2, rng=rng).random(rays)
        self.matrix = np.zeros((count, patches))
        for first in range(count):
            shifted = (base + rng.random(2)) % 1.0
            points, kind = self._leave(first, shifted)
            on, other = kind == 0, kind > 0
            self.matrix[first] += np.bincount(_patch(points[on]), minlength=patches) / rays
            onwards = np.where(
                on,
                paint(points / RADIUS),
                np.array([0, WALL_ALBEDO, DECK_ALBEDO, POD_ALBEDO])[kind],
            )
            nearest = np.where(on, _grid_node(points), self._elsewhere(points, kind))
            weight = np.bincount(nearest[on | other], onwards[on | other], minlength=count) / rays
            self.matrix[first] += weight @ walked

    def _leave(self, receiver: int, random: Array) -> tuple[Array, Index]:
        point = np.repeat(self._points[receiver][None], len(random), axis=0)
        normal = normals(point, np.full(len(random), self._kind[receiver]))
        return hit(point, scattered_rays(normal, random))

    def _walked(self, receiver: int, walks: int, rng: np.random.Generator) -> Array:
        """Row of the matrix by walks that end where the paint takes them."""
        points, kind = self._leave(receiver, rng.random((walks, 2)))
        total = np.zeros(SENDERS[0] * SENDERS[1])
        while len(points):
            on = kind == 0
            total += np.bincount(_patch(points[on]), minlength=len(total))
            albedo = np.array([0, WALL_ALBEDO, DECK_ALBEDO, POD_ALBEDO])[np.maximum(kind, 0)]
            albedo[on] = paint(points[on] / RADIUS)
            goes_on = (rng.random(len(points)) < albedo) & (kind >= 0)
            points, kind = points[goes_on], kind[goes_on]
            points, kind = hit(
                points, scattered_rays(normals(points, kind), rng.random((len(points), 2)))
            )
        return total / walks

    def _elsewhere(self, points: Array, kind: Index) -> Index:
        """The nearest receiver (n,) off the dome, of the same kind."""
        first = RECEIVERS[0] * RECEIVERS[1]
        chosen = np.full(len(points), first)
        for surface in (1, 2, 3):
            here = np.flatnonzero(self._kind == surface)
            use = kind == surface
            away = np.linalg.norm(points[use][:, None] - self._points[here], axis=-1)
            chosen[use] = here[np.argmin(away, axis=1)]
        return chosen


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
    kind = np.repeat([0, 1, 2, 3], [RECEIVERS[0] * RECEIVERS[1], third, third, third])
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


class Cells:
    """Parts of the dome that are seen as one: their paint, and what they send of a projector's light.

    `points` (n, K, 3): K places of each of n cells, with equal weight; `on_dome` (n, K). What is not on the
    dome is black.
    """

    def __init__(
        self, room: "ForeignRoom", points: Array, on_dome: NDArray[np.bool_], shape: tuple[int, ...]
    ) -> None:
        self._shape = shape
        albedo = np.where(on_dome, paint(points / RADIUS), 0)
        self._albedo = albedo.mean(axis=1).astype(np.float32)
        self._place = _grid_place(points[:, points.shape[1] // 2])
        self._seen = {
            name: _matrix(projector, points, albedo) for name, projector in room.projectors.items()
        }

    @property
    def albedo(self) -> Image:
        """Mean albedo, of the cells' shape."""
        return self._albedo.reshape(self._shape)

    def direct(self, panels: Mapping[str, Image]) -> Image:
        """Radiance (..., 3) of the light of panels (H, W, 3) after its first bounce."""
        total = np.zeros((len(self._albedo), 3), np.float32)
        for name, panel in panels.items():
            total += self._seen[name] @ panel.reshape(-1, 3)
        return total.reshape(*self._shape, 3)

    def scattered(self, at_receivers: Array) -> Image:
        """Radiance (..., 3) of scattered light, by a smooth curve through the receivers (n, 3)."""
        grid = at_receivers[: RECEIVERS[0] * RECEIVERS[1]].reshape(*RECEIVERS, 3)
        grid = np.pad(grid, ((0, 0), (4, 4), (0, 0)), mode="wrap")
        row, column = self._place
        planes = [
            map_coordinates(grid[..., c], [row, column + 4], order=3, mode="nearest")
            for c in range(3)
        ]
        light = np.stack(planes, axis=-1) * self._albedo[:, None]
        return light.reshape(*self._shape, 3).astype(np.float32)


def _matrix(projector: Projector, points: Array, albedo: Array) -> csr_array:
    """Radiance of cells (n,) per light of a panel's pixels, from the four round each place (n, K)."""
    width, height = projector.size
    pixel = projector.pixels(points)
    weight = albedo * np.nan_to_num(projector.light(points, pixel)) / points.shape[1]
    cell = np.broadcast_to(np.arange(len(points))[:, None], weight.shape)
    use = (weight > 0) & (pixel > -1).all(axis=-1) & (pixel < projector.size).all(axis=-1)
    pixel, weight, cell = pixel[use], weight[use], cell[use]
    first = np.floor(pixel).astype(int)
    share = pixel - first
    rows, columns, values = [], [], []
    for right, down in np.ndindex(2, 2):
        x, y = first[:, 0] + right, first[:, 1] + down
        value = weight * np.abs(1 - right - share[:, 0]) * np.abs(1 - down - share[:, 1])
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        rows.append(cell[inside])
        columns.append((y * width + x)[inside])
        values.append(value[inside].astype(np.float32))
    place = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.concatenate(values), place), (len(points), width * height))


class ForeignRoom:
    """The dome with its projectors and its camera."""

    def __init__(self, panel: tuple[int, int], camera_px: int, walks: int, rays: int) -> None:
        self.projectors, self.camera = make_projectors(panel), make_camera(camera_px)
        self._bounces = Bounces(walks, rays).matrix
        places = _patch_places()
        self._patches = Cells(self, places, np.ones(places.shape[:2], bool), (len(places),))

    def from_camera(self) -> Cells:
        """What the camera's pixels see (H, W), by nine rays each."""
        size = self.camera.size
        third = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2) / 3
        pixel = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1).reshape(-1, 1, 2)
        rays = self.camera.rays(pixel + third)
        flat = np.nan_to_num(rays.reshape(-1, 3))
        points, kind = hit(np.broadcast_to(self.camera.place, flat.shape), flat)
        seen = (kind == 0) & np.isfinite(rays[..., 0]).ravel()
        points = np.where(seen[:, None], points, [0, 0, RADIUS]).reshape(rays.shape)
        return Cells(self, points, seen.reshape(rays.shape[:2]), (size, size))

    def from_centre(self, direction: Array, inside: NDArray[np.bool_]) -> Cells:
        """The dome along unit directions (H, W, 3) from its centre."""
        on = inside & (direction[..., 2] >= np.cos(HALF_ANGLE))
        points = np.where(on[..., None], RADIUS * direction, [0, 0, RADIUS])
        return Cells(self, points.reshape(-1, 1, 3), on.reshape(-1, 1), on.shape)

    def sent(self, drives: Mapping[str, Image]) -> dict[str, Image]:
        """Light of the panels of the projectors that are on."""
        return {name: self.projectors[name].sent(drive) for name, drive in drives.items()}

    def bounced(self, panels: Mapping[str, Image]) -> Array:
        """Scattered irradiance (n, 3) at the receivers."""
        return np.asarray(self._bounces @ self._patches.direct(panels))

    def photographed(self, view: Cells, drives: Mapping[str, Image]) -> Image:
        """Radiance (H, W, 3) at the camera, without veil, noise or vignetting."""
        panels = self.sent(drives)
        return cv2.GaussianBlur(
            view.direct(panels) + view.scattered(self.bounced(panels)), (0, 0), 0.4
        )


def _patch_places() -> Array:
    """Points (patches, CUTS^2, 3) that share out every patch evenly."""
    share = (np.arange(SENDERS[0] * CUTS) + 0.5) / (SENDERS[0] * CUTS)
    cosine = 1 - share * (1 - np.cos(HALF_ANGLE))
    turn = 2 * np.pi * (np.arange(SENDERS[1] * CUTS) + 0.5) / (SENDERS[1] * CUTS)
    sine = np.sqrt(1 - cosine**2)[:, None]
    points = RADIUS * np.stack(
        [sine * np.cos(turn), sine * np.sin(turn), cosine[:, None] + 0 * turn], axis=-1
    )
    cut = points.reshape(SENDERS[0], CUTS, SENDERS[1], CUTS, 3).swapaxes(1, 2)
    return cut.reshape(SENDERS[0] * SENDERS[1], CUTS**2, 3)
