"""A board seen by several devices in several views: the unknowns, the corners, the residuals."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.maths.geometry.lenses import Lens, project
from procam.maths.geometry.pose import Pose
from procam.maths.statistics import robust_sigma_2d

MIN_SIGMA_PX = 1e-9  # keeps exact corners from dividing by zero


@dataclass(frozen=True, slots=True)
class BoardRig:
    """The unknowns of a board adjustment.

    Attributes
    ----------
    lenses : one per device.
    devices : pose of each device: x_device = pose.apply(x_first); the identity for the first.
    boards : pose of the board in each view: x_first = pose.apply(x_board).
    bend : (3,) coefficients of u^2, v^2 and u v in the board's height [m]; (u, v) is the offset from
        the board's centre over its half diagonal.
    """

    lenses: tuple[Lens, ...]
    devices: tuple[Pose, ...]
    boards: tuple[Pose, ...]
    bend: Array


@dataclass(frozen=True)
class Corners:
    """The corners of V views by D devices, concatenated to T corners.

    Attributes
    ----------
    points : (T, 3) on the flat board [m].
    pixels : (D, T, 2) as observed by each device [px].
    use : (D, T) which observations are fitted.
    starts : (V + 1,) index of the first corner of each view, and T.
    area : (2, 2) lowest and highest x, y of the board's corners [m].
    """

    points: Array
    pixels: Array
    use: BoolArray
    starts: IndexArray
    area: Array

    @property
    def views(self) -> list[slice]:
        """The index range of each view."""
        return [slice(a, b) for a, b in itertools.pairwise(self.starts)]

    @cached_property
    def view_of(self) -> IndexArray:
        """Index of the view of each corner (T,)."""
        return np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))

    @cached_property
    def sag(self) -> Array:
        """Derivatives (T, 3) of the board's height by its bend."""
        low, high = self.area
        half = float(np.linalg.norm(high - low)) / 2
        u, v = ((self.points[:, :2] - (low + high) / 2) / half).T
        return np.stack([u * u, v * v, u * v], axis=1)

    def only(self, views: list[int]) -> "Corners":
        """The same corners with only the observations of some views in use."""
        use = np.zeros_like(self.use)
        for view in views:
            use[:, self.views[view]] = self.use[:, self.views[view]]
        return replace(self, use=use)


def stack_corners(points: Sequence[Array], pixels: Sequence[Array]) -> Corners:
    """Concatenate views: per view, points (N, 3) [m] and pixels (D, N, 2), NaN where not observed."""
    every, where = np.concatenate(points), np.concatenate(pixels, axis=1)
    area = np.stack([every[:, :2].min(axis=0), every[:, :2].max(axis=0)])
    starts = np.cumsum([0, *(len(p) for p in points)])
    seen = np.asarray(np.isfinite(where).all(axis=2), np.bool_)
    return Corners(every, where, seen, starts, area)


def residuals(corners: Corners, rig: BoardRig) -> Array:
    """Predicted minus observed pixel (D, T, 2) [px]; NaN where a corner is not observed."""
    placed = corner_points(corners, rig)
    seen = [project(d.apply(placed), lens) for d, lens in zip(rig.devices, rig.lenses, strict=True)]
    return np.stack(seen) - corners.pixels


def residual_sigmas(corners: Corners, error: Array) -> Array:
    """Robust standard deviation (D,) per axis of residuals (D, T, 2) of each device [px]."""
    lengths = np.nan_to_num(np.linalg.norm(error, axis=2), nan=np.inf, posinf=np.inf)
    sigma = [robust_sigma_2d(row[use]) for row, use in zip(lengths, corners.use, strict=True)]
    return np.maximum(sigma, MIN_SIGMA_PX)


def corner_points(corners: Corners, rig: BoardRig) -> Array:
    """Corners (T, 3) of the bent boards in the frame of the first device [m]."""
    bent = corners.points.copy()
    bent[:, 2] += corners.sag @ rig.bend
    views = zip(rig.boards, corners.views, strict=True)
    return np.concatenate([pose.apply(bent[view]) for pose, view in views])
