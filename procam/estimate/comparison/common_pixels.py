"""One rig as two calibrations tell it: what their pixels' directions have in common, and what not.

A is the first calibration, B the second; directions of B are turned into A's frame.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.errors import NotEnoughData
from procam.maths.geometry.harmonics import harmonics
from procam.maths.geometry.pose import align_rotation
from procam.model.calibration import ProjectorCalibration
from procam.model.correspondence import ProjectorSurface

Array = NDArray[np.float64]
Map = NDArray[np.float32]
FEWEST = 20  # pixels that two calibrations must share of a projector: a motion has six numbers
FIT_PIXELS = 4000  # that fits look at; their fields have a few dozen numbers
GOLDEN = (5**0.5 - 1) / 2  # steps by it lie evenly, and repeat no column of a panel
ROUNDING = 5e-8  # [rad] of two directions stored as float32; keeps error over sigma finite
SMOOTH_DEGREE = 4  # of wrong lenses it leaves less than noise; 2 leaves twice as much
AXES = np.eye(3)


@dataclass(frozen=True, slots=True)
class CommonPixels:
    """One projector in two calibrations, over the N pixels that are valid and told of in both.

    Attributes
    ----------
    first, second : (N, 3) unit directions of A and of B.
    variance : (N,) of their difference as both tell it, both ways across together [rad^2].
    first_sr, second_sr : (N,) solid angles [sr].
    alone : share of the pixels valid in either that is valid in one only [-].
    place : (3,) the projector's, in A, over the radius of the screen [-].
    """

    first: Map
    second: Map
    variance: Map
    first_sr: Map
    second_sr: Map
    alone: float
    place: Array

    def thinned(self, most: int = FIT_PIXELS) -> "CommonPixels":
        """At most `most` of the pixels, spread evenly."""
        count = len(self.variance)
        if count <= most:
            return self
        some = (np.arange(most) * GOLDEN % 1 * count).astype(int)
        return CommonPixels(
            self.first[some],
            self.second[some],
            self.variance[some],
            self.first_sr[some],
            self.second_sr[some],
            self.alone,
            self.place,
        )

    def step(self, turn: Array) -> Array:
        """B's directions turned by `turn` (3, 3), minus A's (N, 3) [rad]."""
        return np.asarray(self.second @ turn.T - self.first)


def common_pixels(
    name: str, first: ProjectorCalibration, second: ProjectorCalibration, radius_m: float
) -> CommonPixels:
    """What A and B tell of the same pixels of projector `name` on a screen of `radius_m`.

    Raises
    ------
    NotEnoughData : fewer than `FEWEST` pixels are valid in both.
    """
    a, b = first.surface, second.surface
    here, there = _told(a), _told(b)
    both = here & there
    count = int(both.sum())
    if count < FEWEST:
        raise NotEnoughData(
            f"projector {name}: got {count} pixels that land on the screen in both calibrations, "
            f"expected {FEWEST} or more; was it lit, and seen, in both visits?"
        )
    variance = a.sigma_arcmin[both] ** 2 + b.sigma_arcmin[both] ** 2
    return CommonPixels(
        a.direction[both],
        b.direction[both],
        np.asarray(np.radians(1 / 60) ** 2 * variance + ROUNDING**2, np.float32),
        a.solid_angle_sr[both],
        b.solid_angle_sr[both],
        1 - count / int((here | there).sum()),
        first.model.projector_from_dome.origin / radius_m,
    )


def _told(surface: ProjectorSurface) -> NDArray[np.bool_]:
    """Pixels (H, W) of which everything is known: the last ones may have a corner off the screen."""
    known = np.isfinite(surface.direction).all(axis=-1) & np.isfinite(surface.sigma_arcmin)
    return surface.valid & known & (surface.solid_angle_sr > 0)


def turn_between(pairs: Iterable[CommonPixels]) -> Array:
    """The turn (3, 3) that best takes B's directions of some projectors into A's."""
    thin = [pair.thinned() for pair in pairs]
    first, second = (np.concatenate([getattr(p, n) for p in thin]) for n in ("first", "second"))
    return align_rotation(second.astype(float), first.astype(float))


def error_over_sigma(step: Array, variance: NDArray[np.floating]) -> float:
    """How differences (N, 3) [rad] compare with variances (N,) [rad^2]: 1 if these are honest."""
    return float(np.sqrt(np.mean(np.sum(step**2, axis=1) / variance)))


def smooth_field(direction: NDArray[np.floating], step: Array, variance: Map) -> Array:
    """The part (N, 3) of differences (N, 3) at unit directions (N, 3) that is one smooth field.

    Gradients of harmonics up to degree `SMOOTH_DEGREE`, and the same turned by a right angle: all
    fields along the sphere of that smoothness, common turns among them.
    """
    unit = direction.astype(np.float64)
    _, slopes = harmonics(unit, 1, SMOOTH_DEGREE)
    across = np.cross(unit[:, None], slopes)
    return _fitted(np.concatenate([slopes, across], axis=1), step, variance)


def own_motion(pair: CommonPixels, step: Array) -> Array:
    """The part (N, 3) of a projector's differences (N, 3) that a small motion of it explains.

    Turned by w and shifted by t it sends pixels to w x (d - o) + t, from where they slide along
    their rays back to the sphere (o its place, d the direction).
    """
    direction = pair.first.astype(float)
    ray = direction - pair.place
    steep = np.sum(direction * ray, axis=1)
    moves = [np.cross(axis, ray) for axis in AXES] + [np.broadcast_to(a, ray.shape) for a in AXES]
    slid = [m - ray * (np.sum(direction * m, axis=1) / steep)[:, None] for m in moves]
    return _fitted(np.stack(slid, axis=1), step, pair.variance)


def _fitted(fields: Array, step: Array, variance: Map) -> Array:
    """Least squares of differences (N, 3) by fields (N, K, 3), each pixel by its variance."""
    weight = 1 / np.sqrt(variance.astype(float))
    rows = np.moveaxis(fields * weight[:, None, None], 1, 2).reshape(-1, fields.shape[1])
    amount = np.linalg.lstsq(rows, (step * weight[:, None]).ravel(), rcond=1e-10)[0]
    return np.asarray(np.einsum("nkc,k->nc", fields, amount))
