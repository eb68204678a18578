"""Scattered light that depends smoothly on where the direct light falls.

On a bare sphere one scalar per channel, the direct flux, determines the scattered light. A floor, seats
or a pod add light that depends on position. That light is smooth and the transport is reciprocal, so
with phi the spherical harmonics up to a degree, made orthonormal over the upper half sphere,

    b+_i = rho_i phi_i^T B M,    M = sum_j a_j phi_j b0_j,    B = B^T

(docs/theory/interreflection.md, I16). Degree 0 is the one scalar. N = I + U V^T has rank K, so both
directions cost O(n K). B follows by linear least squares from pictures of known direct light; the
ratio of their scattered light to that of full white does not depend on the albedo (I17).
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from procam.arrays import Array, BoolArray, IndexArray
from procam.maths.geometry.harmonics import harmonics

# weight of the prior towards a bare sphere's B, times the number of pictures squared: the errors of
# the pictures are correlated, so their number must not weaken it. A third or three times it does as well
PRIOR_WEIGHT = 1.0
BOOLE = (7, 32, 12, 32, 7)  # weights of Boole's rule, whose points are equally spaced


def basis(direction: Array, degree: int) -> Array:
    """Functions phi (N, K) at unit directions (N, 3), K = (degree + 1)^2; the first is 1.

    They are orthonormal over the upper half sphere. The harmonics themselves are nearly dependent
    there, and a fit to them gives large coefficients that cancel.
    """
    if degree == 0:
        return np.ones((len(direction), 1))
    return harmonics(np.asarray(direction, float), 0, degree)[0] @ _half_sphere(degree)


@cache
def _half_sphere(degree: int) -> Array:
    """(K, K) upper triangular matrix from harmonics to functions orthonormal on the half sphere.

    Products of harmonics are polynomials of degree 2 `degree`, which Boole's rule in z (up to 5) and
    equally spaced points in azimuth integrate exactly.
    """
    count = 2 * degree + 1
    z = np.repeat(np.linspace(0, 1, len(BOOLE)), count)
    azimuth = np.tile(2 * np.pi * np.arange(count) / count, len(BOOLE))
    across = np.sqrt(1 - z * z)
    direction = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=1)
    phi = harmonics(direction, 0, degree)[0]
    gram = (phi * np.repeat(np.array(BOOLE) / sum(BOOLE) / count, count)[:, None]).T @ phi
    return np.asarray(np.linalg.inv(np.linalg.cholesky(gram)).T)


def moments(direct: Array, solid_angle_sr: Array, phi: Array) -> Array:
    """Moments M (K, C) [rel sr] of direct light (N, C) over patches (N,); the first row is the flux."""
    return np.asarray(phi.T @ (solid_angle_sr[:, None] * direct))


@dataclass(frozen=True, slots=True)
class ZoneMeasurements:
    """Normal equations for B of one channel, per picture, so that any subset can be fitted.

    Attributes
    ----------
    normal : (P, T, T) normal equations of each picture for the T free entries of B.
    mean : (T,) derivatives of the mean scattered light of full white by these entries.
    white : (K,) moments of full white per unit of its flux.
    """

    normal: Array
    mean: Array
    white: Array

    @classmethod
    def of(
        cls, phi: Array, pictures: tuple[Array, Array, Array], white: Array
    ) -> "ZoneMeasurements":
        """Normal equations from pictures.

        Parameters
        ----------
        phi : (N, K) at the patches.
        pictures : ratio (P, N) of the scattered light to that of full white per unit of flux, NaN
            where unknown; weight (P, N); moment (P, K) of the direct light.
        white : (K,) moments of full white.

        Notes
        -----
        Per unit of flux and of albedo, full white scatters E_i = phi_i^T B M_w / flux_w to a patch.
        Picture p scatters ratio_pi E_i = phi_i^T B M_p. Hence phi_i^T B (M_p - ratio_pi M_w / flux_w) = 0
        for any albedo (I17).
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

    def fit(self, pictures: BoolArray) -> tuple[Array, Array]:
        """B (K, K) and the profile g (K,) of full white, E_i = phi_i.g, from a subset of pictures (P,).

        Least squares under the constraint that E is 1 on average. Entries that no picture determines
        stay near 0, their value for a bare sphere (all but the first).
        """
        normal = self.normal[pictures].sum(axis=0)
        prior = PRIOR_WEIGHT * np.count_nonzero(pictures) ** 2
        normal[np.diag_indices(len(normal))] += np.where(np.arange(len(normal)) > 0, prior, 0)
        entries = np.linalg.solve(normal, self.mean)
        size = len(self.white)
        matrix = np.zeros((size, size))
        matrix[np.triu_indices(size)] = entries / (self.mean @ entries)
        matrix = np.triu(matrix) + np.triu(matrix, 1).T
        return matrix, matrix @ self.white


def predicted_ratio(phi: Array, matrix: Array, profile: Array, moment: Array) -> Array:
    """Ratio (P, N), as in `ZoneMeasurements.of`, predicted for pictures of moments (P, K)."""
    return np.asarray((moment @ matrix) @ phi.T / (phi @ profile))


def _symmetric_rows(phi: Array, moment: Array, upper: tuple[IndexArray, IndexArray]) -> Array:
    """Derivatives (S, K (K + 1) / 2) of phi^T B M, for rows (S, K) of both, by the upper triangle of B."""
    first, second = upper
    rows = phi[:, first] * moment[:, second]
    return np.asarray(rows + np.where(first == second, 0, phi[:, second] * moment[:, first]))
