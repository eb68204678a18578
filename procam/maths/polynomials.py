"""Smooth functions of two coordinates, fitted to scattered values."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from procam.arrays import Array
from procam.maths.statistics import robust_sigma

ROUNDS = 3  # of rejecting outliers
MAX_POINTS = 20_000
OUTLIER_SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class Surface2D:
    """A polynomial of total degree `degree` in two coordinates, with C values.

    (xy - `centre`) / `half`, each (2,), is in -1..1; `coefficients` (T, C) are of products of Legendre
    polynomials, for good conditioning.
    """

    degree: int
    centre: Array
    half: Array
    coefficients: Array

    def __call__(self, xy: Array) -> Array:
        """Values (N, C) at coordinates (N, 2)."""
        return np.asarray(_terms(self._scaled(xy), self.degree) @ self.coefficients)

    def gradient(self, xy: Array) -> Array:
        """Derivatives (N, C, 2) by the two coordinates."""
        scaled = self._scaled(xy)
        parts = [
            _terms(scaled, self.degree, i) @ self.coefficients / self.half[i] for i in range(2)
        ]
        return np.stack(parts, axis=-1)

    def _scaled(self, xy: Array) -> Array:
        return np.asarray((xy - self.centre) / self.half)


def fit_surface(xy: Array, values: Array, degree: int) -> Surface2D:
    """Fit values (N, C) at coordinates (N, 2) by least squares without outliers.

    Of many points, some `MAX_POINTS` evenly picked ones are used.
    """
    some = slice(None, None, max(1, len(xy) // MAX_POINTS))
    xy, values = xy[some], values[some]
    low, high = xy.min(axis=0), xy.max(axis=0)
    centre, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
    terms = _terms((xy - centre) / half, degree)
    use = np.ones(len(xy), bool)
    for _ in range(ROUNDS):
        coefficients = np.linalg.lstsq(terms[use], values[use], rcond=None)[0]
        miss = np.abs(values - terms @ coefficients).max(axis=1)
        use = miss <= OUTLIER_SIGMAS * robust_sigma(miss, 0.0) + 1e-12
    return Surface2D(degree, centre, half, np.asarray(coefficients, float))


def _terms(scaled: Array, degree: int, derivative: int | None = None) -> Array:
    """Products (N, T) of Legendre polynomials up to a total degree, or one derivative of them."""
    lines = []
    for i in range(2):
        table = legendre.legvander(scaled[:, i], degree)
        if i == derivative:
            steps = legendre.legder(np.eye(degree + 1))
            table = legendre.legvander(scaled[:, i], degree - 1) @ steps
        lines.append(table)
    pairs = [(a, b) for a in range(degree + 1) for b in range(degree + 1 - a)]
    return np.stack([lines[0][:, a] * lines[1][:, b] for a, b in pairs], axis=1)
