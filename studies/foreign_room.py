"""A dome that shares nothing with procam or its simulator: projectors, camera, and the light that it sees.

Camera pixels see by nine rays each, which end where a projector's picture is looked up once and for all.
Light is in camera full scale per second.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from studies.foreign_bounces import (
    DOME,
    HALF_ANGLE,
    RADIUS,
    Bounces,
    hit,
    irradiance_at,
    paint,
    patch_places,
)

Array = NDArray[np.float64]
Image = NDArray[np.float32]
PLATES = np.radians(82.0)  # no light of projectors beyond this polar angle
DARK = 1e-9


@dataclass(frozen=True)
class Projector:
    """A projector on the rim: `place` (3,), `rotation` (3, 3) with rows right, down and ahead."""

    size: tuple[int, int]
    place: Array
    rotation: Array
    white: Array  # (3, 3) light in the camera's channels per primary
    gamma: Array
    wider: float  # share by which the lens makes pictures wider
    hot_spot: (
        float  # light in the middle of the panel over that in its corners, beside an even lens
    )

    @property
    def focal_px(self) -> Array:
        """Focal lengths (2,)."""
        return 0.58 * self.size[0] * np.array([1 + self.wider, 1])

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
        lens = (1 - 0.8 * corner**2) * self.hot_spot ** -np.clip(4 * corner**2, 0, 1)
        return np.asarray(90.0 * inside * lens * incidence / distance**2)

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


def make_projectors(size: tuple[int, int], hot_spot: float = 1.0) -> dict[str, Projector]:
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
        made[name] = Projector(size, place, rotation, mix, gamma, 4e-5 * (number - 1), hot_spot)
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
        self._middle = points[:, points.shape[1] // 2]
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
        light = irradiance_at(self._middle, at_receivers) * self._albedo[:, None]
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

    def __init__(
        self, panel: tuple[int, int], camera_px: int, walks: int, rays: int, hot_spot: float
    ) -> None:
        self.projectors = make_projectors(panel, hot_spot)
        self.camera = make_camera(camera_px)
        self._bounces = Bounces(walks, rays).matrix
        places = patch_places()
        self._patches = Cells(self, places, np.ones(places.shape[:2], bool), (len(places),))

    def from_camera(self) -> Cells:
        """What the camera's pixels see (H, W), by nine rays each."""
        size = self.camera.size
        third = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2) / 3
        pixel = np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1).reshape(-1, 1, 2)
        rays = self.camera.rays(pixel + third)
        flat = np.nan_to_num(rays.reshape(-1, 3))
        points, kind = hit(np.broadcast_to(self.camera.place, flat.shape), flat)
        seen = (kind == DOME) & np.isfinite(rays[..., 0]).ravel()
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
