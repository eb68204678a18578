"""Where rays meet a dome that is a sphere, or nearly one, and how that place moves."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from procam.kernels import ShapeDerivatives
from procam.kernels.bundle.reference import Hit, on_screen
from procam.maths.geometry.harmonics import harmonic_count, harmonics
from procam.maths.geometry.sphere import intersect_sphere

Array = NDArray[np.float64]
LOWEST = 2  # degree 0 is the radius, degree 1 another centre


@dataclass(frozen=True, slots=True)
class RoundShape:
    """A surface |x| = radius (1 + sum of coefficients times harmonics of x/|x|).

    Attributes
    ----------
    radius_m : of the sphere [m]. bumps : (K,) coefficients of the harmonics from degree 2 on,
        relative to the radius; none for an exact sphere. degree : the highest.
    """

    radius_m: float
    bumps: Array = field(default_factory=lambda: np.zeros(0))
    degree: int = 0

    @property
    def exact(self) -> bool:
        """Whether it is a sphere."""
        return not self.degree

    def waves(self, direction: Array) -> tuple[Array, Array]:
        """Harmonics (N, K) and slopes (N, K, 3) in unit directions (N, 3)."""
        if self.exact:
            return np.zeros((len(direction), 0)), np.zeros((len(direction), 0, 3))
        return harmonics(direction, LOWEST, self.degree)

    def reach(self, direction: Array) -> Array:
        """Distance (N,) [m] from the centre in unit directions (N, 3)."""
        return self.radius_m * (1 + self.waves(direction)[0] @ self.bumps)

    def relief(self, origin: Array, direction: Array) -> ShapeDerivatives | None:
        """Harmonics where rays (N, 3) from inside meet the sphere; None if it is exact.

        They go on as their tangents do: `meet` and `hit` may be given those of rays 1e-3 rad off,
        of other coefficients and another radius, at an error below 1e-7 of it for every 1e-4 of the
        coefficients.
        """
        if self.exact:
            return None
        start = intersect_sphere(origin, direction, self.radius_m) / self.radius_m
        return ShapeDerivatives(start, *self.waves(start))

    def meet(
        self, origin: Array, direction: Array, relief: ShapeDerivatives | None = None
    ) -> Array:
        """Points (N, 3) [m] where rays from inside meet the surface; NaN if they miss."""
        return self.hit(origin, direction, relief)[0]

    def hit(self, origin: Array, direction: Array, relief: ShapeDerivatives | None = None) -> Hit:
        """Where rays meet the surface; its relief is taken where they meet the sphere unless given."""
        relief = self.relief(origin, direction) if relief is None else relief
        return on_screen(origin, direction, self.radius_m, self.bumps, relief)


def shape_coefficient_count(degree: int) -> int:
    """Number of coefficients up to a degree; 0 for an exact sphere."""
    return harmonic_count(LOWEST, degree) if degree else 0
