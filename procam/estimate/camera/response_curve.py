"""A rising curve whose logarithmic slope is a cubic spline, for the inverse response of a camera."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import BSpline

from procam.arrays import Array

SPLINE_INTERVALS = 60
GRID = 1025  # levels at which the curve is tabulated
# knots crowd at black; white gets this share of it, since tone curves roll off there
END_SHARE = 0.6


@dataclass(frozen=True, slots=True)
class LogSlopeCurve:
    """Unscaled inverse response on a grid of levels: its slope is exp(basis @ bends)."""

    levels: Array
    basis: Array
    bends: Array

    @property
    def slope(self) -> Array:
        """Derivative of the light by the level (G,)."""
        return np.exp(self.basis @ self.bends)

    def light(self) -> Array:
        """Light (G,)."""
        return np.asarray(cumulative_trapezoid(self.slope, self.levels, initial=0))

    def by_bends(self) -> Array:
        """Derivatives (G, P) of the light."""
        steep = self.slope[:, None] * self.basis
        return np.asarray(cumulative_trapezoid(steep, self.levels, axis=0, initial=0))


def initial_curve() -> LogSlopeCurve:
    """A gamma of 2, with dense knots near black and white, where curves bend most."""
    uniform = np.linspace(0, 1, GRID)
    levels = (1 - END_SHARE) * uniform**2 + END_SHARE * np.sin(np.pi / 2 * uniform) ** 2
    knots = np.concatenate([np.zeros(3), np.linspace(0, 1, SPLINE_INTERVALS + 1), np.ones(3)])
    basis = BSpline.design_matrix(uniform, knots, 3).toarray()
    bends = np.linalg.lstsq(basis, np.log(levels + 0.01), rcond=None)[0]
    # the last one is fixed, since a common factor of light and brightness is free
    return LogSlopeCurve(levels, basis[:, :-1], (bends - bends[-1])[:-1])


def second_differences(count: int) -> Array:
    """Matrix of the second differences of `count` coefficients and a last one that is 0."""
    return np.diff(np.eye(count + 1), 2, axis=0)[:, :-1]
