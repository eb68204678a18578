"""Boards and lenses that no estimator of procam has a model of.

The board curls up at one side like paper: its curvature grows along the sheet and no length changes. The
lens has thin-prism terms; OpenCV projects with them. The noise of the corners differs from view to view.
Nothing here uses procam. The true parameters of such a lens are those of the nearest lens of the
fitted kind over a part of the picture, turned freely: turning a lens is turning the camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
SIZE, PANEL = (1300, 1020), (1280, 800)
COLUMNS, ROWS, SQUARE_M = 13, 9, 0.0135
NOISE_PX = (0.03, 0.3)  # least and most of a view
PRISM = 5e-4  # of a coefficient; 0.1 to 0.4 px at the corners of the picture
CURL = (0.005, 0.015)  # height of the far edge over the width of the board
LEAST_SHARE = 0.5  # of the corners, that a view must show
REACH = 1.2  # tangent of the angle off the axis up to which the lenses are monotonic
SCALE = np.array([1e3] * 4 + [1.0] * 8)  # of the parameters below


@dataclass(frozen=True)
class PrismLens:
    """A pinhole of `parameters` fx, fy, cx, cy, k1, k2, p1, p2, k3 with thin-prism terms s1..s4."""

    parameters: Array
    prism: Array

    def project(self, points: Array) -> Array:
        """Pixels (N, 2) of points (N, 3)."""
        fx, fy, cx, cy = self.parameters[:4]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        terms = np.concatenate([self.parameters[4:], np.zeros(3), self.prism])
        still = np.zeros(3)
        seen = cv2.projectPoints(points.reshape(-1, 1, 3), still, still, matrix, terms)[0]
        return np.asarray(seen, float).reshape(-1, 2)

    def nearest(self, seen_at: Sequence[Array]) -> tuple[Array, Array]:
        """Parameters (9,) of the nearest lens without prism, and its turn (3, 3).

        Over the rectangle of all these pixels (N, 2), NaN where nothing is seen.
        """
        side = np.tan(np.linspace(-0.75, 0.75, 41))
        x, y = np.meshgrid(side, side)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
        shown = np.concatenate([pixels[np.isfinite(pixels[:, 0])] for pixels in seen_at])
        seen = self.project(rays)
        inside = ((seen >= shown.min(axis=0)) & (seen <= shown.max(axis=0))).all(axis=1)
        rays, seen = rays[inside], seen[inside]

        def miss(unknown: Array) -> Array:
            turned = rays @ Rotation.from_rotvec(unknown[9:]).as_matrix().T
            plain = PrismLens((unknown * SCALE)[:9], np.zeros(4))
            return np.asarray((plain.project(turned) - seen).ravel())

        start = np.concatenate([self.parameters, np.zeros(3)]) / SCALE
        found = least_squares(miss, start, method="lm", xtol=1e-12, ftol=1e-12).x
        return (found * SCALE)[:9], Rotation.from_rotvec(found[9:]).as_matrix()


def draw_lens(rng: np.random.Generator, prism: float, middle: tuple[float, float]) -> PrismLens:
    """A lens of some 905 px, its principal point near `middle` [px]."""
    focal, centre = rng.normal(905, 5, 2), rng.normal(middle, 5)
    terms = [rng.normal(-0.2, 0.02), 0.08, *rng.normal(0, 4e-4, 2), 0.0]
    return PrismLens(np.concatenate([focal, centre, terms]), rng.normal(0, prism, 4))


def flat_board() -> Array:
    """Corners (N, 3), row by row [m]."""
    row, column = np.mgrid[:ROWS, :COLUMNS]
    grid = np.stack([column.ravel(), row.ravel(), 0 * row.ravel()], axis=1)
    return np.asarray(grid * SQUARE_M, np.float64)


def curled_board(rng: np.random.Generator, share: float) -> Array:
    """The corners where they are when one side rises by `share` of the board's width [m]."""
    flat, angle = flat_board(), rng.uniform(0, 2 * np.pi)
    along = np.array([np.cos(angle), np.sin(angle), 0.0])
    place = (flat - flat.mean(axis=0)) @ along
    width = np.ptp(place)
    over = np.maximum(place - place.min() - rng.uniform(0.2, 0.6) * width, 0)
    arc = np.linspace(0, over.max(), 2000)
    slope = arc**2 * (share * width / np.trapezoid(arc**2, arc))  # the curvature grows linearly
    inward = np.interp(over, arc, _integral(np.cos(slope), arc)) - over
    rise = np.interp(over, arc, _integral(np.sin(slope), arc)) * rng.choice([-1.0, 1.0])
    return np.asarray(flat + inward[:, None] * along + rise[:, None] * np.array([0.0, 0.0, 1.0]))


def draw_pose(rng: np.random.Generator) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [m] of a board that faces the camera, but for a tilt."""
    tilt = Rotation.from_rotvec(rng.normal(0, 0.45, 3) * [1, 1, 0.3])
    azimuth, angle = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.6)
    facing = Rotation.from_rotvec(angle * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]))
    rotation = (facing * tilt).as_matrix()
    middle = flat_board().mean(axis=0)
    return rotation, facing.as_matrix()[:, 2] * rng.uniform(0.2, 0.45) - rotation @ middle


def photograph(
    rng: np.random.Generator, lens: PrismLens, points: Array, size: tuple[int, int]
) -> Array:
    """Noisy pixels (N, 2) of points (N, 3), NaN outside the picture; one noise per view."""
    seen = lens.project(points)
    slant = np.hypot(points[:, 0], points[:, 1]) / np.maximum(points[:, 2], 1e-9)
    seen[~_within(seen, size) | (slant > REACH)] = np.nan
    return np.asarray(seen + rng.normal(0, np.exp(rng.uniform(*np.log(NOISE_PX))), seen.shape))


def enough(seen: Sequence[Array]) -> bool:
    """Whether half of the corners are in every device's picture."""
    return all(np.isfinite(pixels[:, 0]).mean() >= LEAST_SHARE for pixels in seen)


def _integral(values: Array, places: Array) -> Array:
    steps = (values[1:] + values[:-1]) / 2 * np.diff(places)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _within(pixels: Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    return np.asarray(((pixels > 0) & (pixels < np.array(size) - 1)).all(axis=1))
