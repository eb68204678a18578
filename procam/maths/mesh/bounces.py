"""All bounces of light between faces of a mesh, by compressed form factors, as a fixed point."""

from collections.abc import Callable

import numpy as np

from procam.arrays import Array
from procam.maths.fixed_point import fixed_point
from procam.maths.mesh.compressed import CompressedFactors

TOLERANCE = 1e-5  # of the brightest irradiance


def settled(factors: CompressedFactors, albedo: Array, direct: Array) -> Array:
    """Irradiance (F, C) after all bounces, of direct light (F, C) and an albedo (F, C)."""
    return settled_by(factors, albedo, lambda _: direct, TOLERANCE)


def settled_by(
    factors: CompressedFactors, albedo: Array, sent: Callable[[Array], Array], tolerance: float
) -> Array:
    """Irradiance (F, C) of an albedo (F, C) and of direct light (F, C) that is `sent` for an irradiance."""

    def step(irradiance: Array) -> Array:
        return factors.gather(sent(irradiance) + albedo * irradiance).astype(float)

    return np.asarray(fixed_point(step, np.zeros(albedo.shape), tolerance), float)
