"""Photographs of AprilTags printed on paper and stuck to a dome."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from procam.maths.codes.april_tags import tag_cells
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.sphere import direction_from_angles, intersect_sphere
from procam.model.optics import AprilTag, TagFamily

FINE = 4  # rays along a pixel's edge
WHITE, BLACK = 1.7, 0.08  # of paper and ink, relative to the screen
FULL, BLACK_LEVEL = 4095, 64


@dataclass(frozen=True)
class Printed:
    """A tag with its centre in a direction [rad] from the dome's centre."""

    number: int
    azimuth: float
    elevation: float
    edge_m: float
    roll: float = 0.0
    family: TagFamily = "36h11"
    mirrored: bool = False

    def listed(self, sigma: float = 1e-5) -> AprilTag:
        """Its entry in venue.toml."""
        return AprilTag(self.family, self.number, self.azimuth, self.elevation, sigma)

    @property
    def direction(self) -> np.ndarray:
        return direction_from_angles(self.azimuth, self.elevation)

    def whiteness(self, points: np.ndarray) -> np.ndarray:
        """Reflectance (N,) of points (N, 3) [m] relative to bare screen, on the tangent plane."""
        out = self.direction
        right = np.cross(out, [0.3, -0.2, 0.93])
        right /= np.linalg.norm(right)
        down = np.cross(out, right)
        right, down = (
            np.cos(self.roll) * right + np.sin(self.roll) * down,
            np.cos(self.roll) * down - np.sin(self.roll) * right,
        )
        paper = np.pad(tag_cells(self.family, self.number), 1, constant_values=True)
        side = len(paper)
        x, y = (
            (points @ axis) / self.edge_m * (side - 2) + side / 2
            for axis in (-right if self.mirrored else right, down)
        )
        inside = (x >= 0) & (x < side) & (y >= 0) & (y < side)
        column, row = (np.clip(v, 0, side - 1).astype(int) for v in (x, y))
        return np.where(inside, np.where(paper[row, column], WHITE, BLACK), 1.0)


def whiteness(
    tags: Iterable[Printed], lens: Lens, size: tuple[int, int], pose: Pose, radius_m: float
) -> np.ndarray:
    """Picture (H, W) of a dome under uniform light, 1 where it is bare."""
    picture = np.ones(size[::-1])
    for tag in tags:
        middle, reach = _window(tag, lens, pose, radius_m)
        left, top = np.maximum(middle - reach, 0)
        right, bottom = np.minimum(middle + reach + 1, size)
        x, y = (
            np.arange(FINE * (end - start)) / FINE + start - 0.5 + 0.5 / FINE
            for start, end in ((left, right), (top, bottom))
        )
        ray = pose.inverse().rotate(unproject(np.stack(np.meshgrid(x, y), -1), lens))
        point = intersect_sphere(pose.origin, ray, radius_m)
        fine = tag.whiteness(point.reshape(-1, 3)).reshape(bottom - top, FINE, right - left, FINE)
        picture[top:bottom, left:right] *= fine.mean(axis=(1, 3))
    return picture


def _window(tag: Printed, lens: Lens, pose: Pose, radius_m: float) -> tuple[np.ndarray, int]:
    """Its centre pixel (2,), and a half-width [px] that contains it."""
    seen = pose.apply(radius_m * tag.direction)
    edge_px = tag.edge_m / np.linalg.norm(seen) * lens.focal.max()
    return np.rint(project(seen, lens)).astype(int), int(1.6 * edge_px) + 3


def photograph(
    light: np.ndarray, rng: np.random.Generator, level: float = 0.4, noise: float = 1.0
) -> np.ndarray:
    """Counts (H, W) of 12 bits: light of slow variation, lens blur, noise of a white SNR of about 100."""
    height, width = light.shape
    x, y = np.meshgrid(np.linspace(0, 9, width), np.linspace(0, 7, height))
    blurred = cv2.GaussianBlur(light * (1 + 0.3 * np.cos(x) * np.sin(y)), (0, 0), 0.5)
    signal = blurred * level * (FULL - BLACK_LEVEL)
    signal += noise * rng.normal(size=light.shape) * np.sqrt(0.4 * signal + 2.25)
    return np.clip(np.rint(signal + BLACK_LEVEL), 0, FULL).astype(np.float32)
