"""Scattered light that depends, smoothly, on where the direct light fell (science.md s.1).

On a bare sphere every patch lights all others alike, and one scalar says it all. A floor, seats or a
pod bend that a little. What they return is smooth on both sides and reciprocal: with phi the
spherical harmonics up to a degree, made orthonormal over the upper half sphere one after the other, a
patch of albedo rho_i gets

    b+_i = rho_i phi_i^T B M,    M = sum_j a_j phi_j b0_j,    B = B^T.

Degree 0 is the one scalar. N = I + U V^T, so that both directions cost O(n K).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from procam.maths.geometry.harmonics import harmonics

Array = NDArray[np.float64]
# of the numbers in B towards a bare sphere's, times the square of the number of pictures: their errors
# go together, so that many pictures do not tell more than one. A third or three times of it serve as well.
PULL = 1.0


def basis(direction: Array, degree: int) -> Array:
    """Functions phi (N, K) at unit directions (N, 3), K = (degree + 1)^2; the first is 1.

    Of mean square 1 over the upper half sphere: harmonics alone are nearly dependent there, and then
    numbers in B that mean nothing grow large.
    """
    if degree == 0:
        return np.ones((len(direction), 1))
    return harmonics(np.asarray(direction, float), 0, degree)[0] @ _half_sphere(degree)


@cache
def _half_sphere(degree: int) -> Array:
    """(K, K) upper triangular, from harmonics to functions orthonormal on the half sphere.

    Products of harmonics are polynomials of degree 2 `degree`: Gauss-Legendre points in z and evenly
    spaced ones in azimuth integrate them exactly.
    """
    points, weights = np.polynomial.legendre.leggauss(degree + 1)
    count = 2 * degree + 1
    z = np.repeat((points + 1) / 2, count)
    azimuth = np.tile(2 * np.pi * np.arange(count) / count, len(points))
    across = np.sqrt(1 - z * z)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    phi = harmonics(direction, 0, degree)[0]
    gram = (phi * np.repeat(weights / 2 / count, count)[:, None]).T @ phi
    return np.asarray(np.linalg.inv(np.linalg.cholesky(gram)).T)


def moments(direct: Array, solid_angle_sr: Array, phi: Array) -> Array:
    """M (K, C) [rel sr] of direct light (N, C) over patches (N,); its first row is the flux."""
    return np.asarray(phi.T @ (solid_angle_sr[:, None] * direct))


@dataclass(frozen=True, slots=True)
class ZoneMeasurements:
    """What pictures of known direct light tell of B, of one colour; any subset of them can be fitted.

    `normal` (P, T, T): normal equations of each picture for the T numbers in B. `mean` (T,): their
    shares in the mean of what white brings. `white` (K,): moments of a unit of white's flux.
    """

    normal: Array
    mean: Array
    white: Array

    @classmethod
    def of(
        cls, phi: Array, pictures: tuple[Array, Array, Array], white: Array
    ) -> "ZoneMeasurements":
        """Gather it.

        Parameters
        ----------
        phi : (N, K) at the patches.
        pictures : ratio (P, N), bounced light over that which a unit of white's flux brings to the
            patch, NaN where unknown; weight (P, N); moment (P, K) of the pictures' direct light.
        white : (K,) moments of white.

        Notes
        -----
        White brings E_i = phi_i^T B M_w / flux_w to a patch, over its paint; a picture ratio_pi E_i, which
        is phi_i^T B M_p: so phi_i^T B (M_p - ratio_pi M_w / flux_w) = 0 whatever the paint.
        """
        upper, white = np.triu_indices(phi.shape[1]), white / white[0]
        ratio, weight, moment = pictures
        known = np.isfinite(ratio) & (weight > 0)
        scale = 1 / (weight[known].mean() * np.mean(moment[:, 0]) ** 2)
        normal = []
        for r, w, m, k in zip(ratio, weight, moment, known, strict=True):
            rows = _symmetric_rows(phi[k], m - r[k, None] * white, upper)
            normal.append((rows * scale * w[k, None]).T @ rows)
        mean = _symmetric_rows(phi.mean(axis=0)[None], white[None], upper)[0]
        return cls(np.array(normal), mean, white)

    def fit(self, pictures: NDArray[np.bool_]) -> tuple[Array, Array]:
        """B (K, K) and white's profile g (K,), E_i = phi_i.g, from some of the pictures (P,).

        Least squares with E on average 1; what no picture shows stays near 0, where B is for a bare
        sphere but for its first number.
        """
        normal = self.normal[pictures].sum(axis=0)
        pull = PULL * np.count_nonzero(pictures) ** 2
        normal[np.diag_indices(len(normal))] += np.where(np.arange(len(normal)) > 0, pull, 0)
        numbers = np.linalg.solve(normal, self.mean)
        size = len(self.white)
        matrix = np.zeros((size, size))
        matrix[np.triu_indices(size)] = numbers / (self.mean @ numbers)
        matrix = np.triu(matrix) + np.triu(matrix, 1).T
        return matrix, matrix @ self.white


def predicted_ratio(phi: Array, matrix: Array, profile: Array, moment: Array) -> Array:
    """Ratio (P, N), as `ZoneMeasurements` takes it, that pictures of moments (P, K) should show."""
    return np.asarray((moment @ matrix) @ phi.T / (phi @ profile))


def _symmetric_rows(
    phi: Array, moment: Array, upper: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> Array:
    """Derivatives (S, K (K + 1) / 2) of phi^T B M, rows (S, K) each, by the upper triangle of B."""
    first, second = upper
    rows = phi[:, first] * moment[:, second]
    return np.asarray(rows + np.where(first == second, 0, phi[:, second] * moment[:, first]))
