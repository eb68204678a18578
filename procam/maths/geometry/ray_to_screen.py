"""Intersects rays with a dome that is a sphere, or nearly one (docs/theory/geometry.md (G1))."""

from dataclasses import dataclass, field

import numpy as np

from procam.arrays import Array, BoolArray
from procam.kernels import ShapeDerivatives
from procam.kernels.bundle.reference import Hit, on_screen
from procam.maths.geometry.harmonics import harmonic_count, harmonics
from procam.maths.geometry.sphere import intersect_sphere

LOWEST_DEGREE = 2  # degree 0 is the radius, degree 1 a shift of the centre
HARMONIC_PRIOR = 3e-4  # of the radius, per coefficient: domes are built to a centimetre


@dataclass(frozen=True, slots=True)
class RoundShape:
    """A surface |x| = radius (1 + sum of coefficients times harmonics of x/|x|).

    Attributes
    ----------
    radius_m : of the sphere [m].
    harmonic_coefficients : (K,) of the spherical harmonics from degree 2 to `degree`, relative to
        the radius [-]; none for a sphere.
    degree : highest degree; 0 for a sphere.
    """

    radius_m: float
    harmonic_coefficients: Array = field(default_factory=lambda: np.zeros(0))
    degree: int = 0

    @property
    def is_sphere(self) -> bool:
        """Whether the surface is an exact sphere."""
        return not self.degree

    @property
    def coefficient_sigmas(self) -> Array:
        """Prior standard deviations (K,) of the coefficients; 0 for fixed ones."""
        return np.full(self.harmonic_coefficients.size, HARMONIC_PRIOR)

    def harmonics_at(self, direction: Array) -> tuple[Array, Array]:
        """Harmonics (N, K) and their gradients (N, K, 3) in unit directions (N, 3)."""
        if self.is_sphere:
            return np.zeros((len(direction), 0)), np.zeros((len(direction), 0, 3))
        return harmonics(direction, LOWEST_DEGREE, self.degree)

    def radius_at(self, direction: Array) -> Array:
        """Distance (N,) [m] of the surface from the centre in unit directions (N, 3)."""
        return self.radius_m * (1 + self.harmonics_at(direction)[0] @ self.harmonic_coefficients)

    def shape_derivatives(self, origin: Array, direction: Array) -> ShapeDerivatives | None:
        """Harmonics and their gradients where rays (N, 3) from inside meet the sphere.

        None for an exact sphere. `on_screen` and the kernels extrapolate them linearly, so one
        evaluation serves for rays up to 1e-3 rad away, other coefficients and another radius; the
        error is below 1e-7 of the radius for coefficients of 1e-4.
        """
        if self.is_sphere:
            return None
        start = intersect_sphere(origin, direction, self.radius_m) / self.radius_m
        return ShapeDerivatives(start, *self.harmonics_at(start))

    def intersect(self, origin: Array, direction: Array) -> Array:
        """Points (N, 3) [m] where rays from inside meet the surface; NaN where they miss."""
        return self.hit(origin, direction).point

    def sees(self, origin: Array, points: Array) -> BoolArray:
        """Whether nothing of it is between an origin (3,) and its points (N, 3); it hides none of itself."""
        return np.ones(len(points), bool)

    def hit(self, origin: Array, direction: Array) -> Hit:
        """Points and outward gradients where rays (N, 3) meet the surface."""
        derivatives = self.shape_derivatives(origin, direction)
        return on_screen(origin, direction, self.radius_m, self.harmonic_coefficients, derivatives)


def shape_coefficient_count(degree: int) -> int:
    """Number of coefficients up to a degree; 0 for an exact sphere."""
    return harmonic_count(LOWEST_DEGREE, degree) if degree else 0
