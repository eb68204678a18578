"""The pixels that two calibrations of one rig share, and motions and fields fitted to them.

A is the first calibration, B the second; directions of B are rotated into A's frame.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Map
from procam.errors import NotEnoughData
from procam.maths.geometry.harmonics import harmonics
from procam.maths.geometry.pose import align_rotation
from procam.maths.geometry.sphere import ARCMIN
from procam.model.calibration import ProjectorCalibration
from procam.model.correspondence import ProjectorSurface

FEWEST = 20  # shared pixels of a projector: a rigid motion has six parameters
FIT_PIXELS = 4000  # that fits use; their fields have a few dozen coefficients
GOLDEN = (5**0.5 - 1) / 2  # multiples modulo 1 are uniform and repeat no column of a panel
ROUNDING = 5e-8  # [rad] of two float32 directions; keeps the error over sigma finite
SMOOTH_DEGREE = 4  # represents errors of lenses to less than the noise; 2 leaves twice as much
AXES = np.eye(3)


@dataclass(frozen=True, slots=True)
class CommonPixels:
    """One projector in two calibrations, over the N pixels that are valid in both.

    Attributes
    ----------
    first, second : (N, 3) unit directions of A and of B.
    variance : (N,) of their difference, sum of both components [rad^2].
    first_sr, second_sr : (N,) solid angles [sr].
    alone : share of the pixels valid in A or B that are valid in one only [-].
    place : (3,) position of the projector in A over the radius of the screen [-].
    """

    first: Map
    second: Map
    variance: Map
    first_sr: Map
    second_sr: Map
    alone: float
    place: Array

    def thinned(self, most: int = FIT_PIXELS) -> "CommonPixels":
        """At most `most` of the pixels, uniformly spread."""
        count = len(self.variance)
        if count <= most:
            return self
        some = (np.arange(most) * GOLDEN % 1 * count).astype(int)
        per_pixel = ("first", "second", "variance", "first_sr", "second_sr")
        return replace(self, **{name: getattr(self, name)[some] for name in per_pixel})

    def step(self, turn: Array) -> Array:
        """B's directions rotated by `turn` (3, 3), minus A's (N, 3) [rad]."""
        return np.asarray(self.second @ turn.T - self.first)


def common_pixels(
    name: str, first: ProjectorCalibration, second: ProjectorCalibration, radius_m: float
) -> CommonPixels:
    """The pixels of projector `name` that are valid in A and B, on a screen of `radius_m`.

    Raises
    ------
    NotEnoughData
        If fewer than `FEWEST` pixels are valid in both.
    """
    a, b = first.surface, second.surface
    here, there = _complete(a), _complete(b)
    both = here & there
    count = int(both.sum())
    if count < FEWEST:
        raise NotEnoughData(
            f"projector {name}: the calibrations share {count} of its pixels and {FEWEST} are needed. "
            "Check that it was on and seen in both capture sessions."
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


def _complete(surface: ProjectorSurface) -> BoolArray:
    """Pixels (H, W) with direction, sigma and solid angle; one at the rim may have no solid angle."""
    known = np.isfinite(surface.direction).all(axis=-1) & np.isfinite(surface.sigma_arcmin)
    return surface.valid & known & (surface.solid_angle_sr > 0)


def turn_between(pairs: Iterable[CommonPixels]) -> Array:
    """The rotation (3, 3) that fits B's directions of some projectors best to A's."""
    thin = [pair.thinned() for pair in pairs]
    first, second = (np.concatenate([getattr(p, n) for p in thin]) for n in ("first", "second"))
    return align_rotation(second.astype(float), first.astype(float))


def error_over_sigma(step: Array, variance: FloatArray) -> float:
    """Rms of differences (N, 3) [rad] over their standard errors; 1 if the variances (N,) are right."""
    return float(np.sqrt(np.mean(np.sum(step**2, axis=1) / variance)))


def rms_arcmin(*steps: Array) -> float:
    """Root mean square of differences (N, 3) [rad], in arcmin."""
    return float(ARCMIN * np.sqrt(np.mean(np.sum(np.concatenate(steps) ** 2, axis=1))))


def smooth_field(direction: FloatArray, step: Array, variance: Map) -> Array:
    """The smooth part (N, 3) of differences (N, 3) at unit directions (N, 3), by least squares.

    The basis is the gradients of harmonics up to degree `SMOOTH_DEGREE` and the same rotated by 90
    degrees: all tangent fields of that degree, rotations of the sphere included.
    """
    unit = direction.astype(np.float64)
    _, slopes = harmonics(unit, 1, SMOOTH_DEGREE)
    across = np.cross(unit[:, None], slopes)
    return _fitted(np.concatenate([slopes, across], axis=1), step, variance)


def own_motion(pair: CommonPixels, step: Array) -> Array:
    """The part (N, 3) of a projector's differences (N, 3) that a small motion of it explains.

    A rotation w and a shift t of a projector at o move the point d by w x (d - o) + t; the new ray
    meets the sphere where that displacement, projected along the ray, is tangential.
    """
    direction = pair.first.astype(float)
    ray = direction - pair.place
    steep = np.sum(direction * ray, axis=1)
    moves = [np.cross(axis, ray) for axis in AXES] + [np.broadcast_to(a, ray.shape) for a in AXES]
    tangential = [m - ray * (np.sum(direction * m, axis=1) / steep)[:, None] for m in moves]
    return _fitted(np.stack(tangential, axis=1), step, pair.variance)


def _fitted(fields: Array, step: Array, variance: Map) -> Array:
    """Weighted least-squares fit (N, 3) of fields (N, K, 3) to differences (N, 3)."""
    weight = 1 / np.sqrt(variance.astype(float))
    rows = np.moveaxis(fields * weight[:, None, None], 1, 2).reshape(-1, fields.shape[1])
    coefficients = np.linalg.lstsq(rows, (step * weight[:, None]).ravel(), rcond=1e-10)[0]
    return np.asarray(np.einsum("nkc,k->nc", fields, coefficients))
