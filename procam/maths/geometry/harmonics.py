"""Real spherical harmonics and their gradients, for domes that are nearly spheres."""

from math import factorial

import numpy as np

from procam.arrays import Array

BLOCK = 512  # directions at a time, so that the intermediate arrays stay in the cache


def harmonic_count(lowest: int, highest: int) -> int:
    """Number of harmonics of degrees lowest..highest.

    >>> harmonic_count(2, 4)
    21
    """
    return (highest + 1) ** 2 - lowest**2


def harmonics(direction: Array, lowest: int, highest: int) -> tuple[Array, Array]:
    """Harmonics (N, K) at unit directions (N, 3) and their gradients (N, K, 3) along the sphere.

    Degrees lowest to highest, each with mean square 1 over the sphere. The orders of a degree are
    0, 1 cos, 1 sin, 2 cos, ... Legendre functions come from the three-term recurrence.
    """
    count = harmonic_count(lowest, highest)
    values, slopes = np.empty((len(direction), count)), np.empty((len(direction), count, 3))
    for at in range(0, len(direction), BLOCK):
        block = slice(at, at + BLOCK)
        value, slope = _block(direction[block].T, lowest, highest)
        values[block], slopes[block] = value.T, slope.transpose(2, 0, 1)
    return values, slopes


def _block(direction: Array, lowest: int, highest: int) -> tuple[Array, Array]:
    """Harmonics (K, N) at unit directions (3, N) and their gradients (K, 3, N)."""
    x, y, z = direction
    cosine, sine = _azimuthal(x, y, highest)
    legendre = _legendre(z, highest)
    zero = np.zeros_like(z)
    values, slopes = [], []
    for degree in range(lowest, highest + 1):
        for order in range(degree + 1):
            scale = _norm(degree, order)
            part, rise = scale * legendre[degree, order], scale * legendre[degree, order + 1]
            c, s = cosine[order], sine[order]
            below = (cosine[order - 1], sine[order - 1]) if order else (zero, zero)
            values.append(part * c)
            slopes.append([order * part * below[0], -order * part * below[1], rise * c])
            if order:
                values.append(part * s)
                slopes.append([order * part * below[1], order * part * below[0], rise * s])
    gradient = np.array(slopes)
    outward = np.einsum("kin,in->kn", gradient, direction)
    return np.array(values), gradient - outward[:, None] * direction


def _azimuthal(x: Array, y: Array, highest: int) -> tuple[list[Array], list[Array]]:
    """Real and imaginary parts of (x + i y)^m."""
    cosine, sine = [np.ones_like(x)], [np.zeros_like(x)]
    for _ in range(highest):
        c, s = cosine[-1], sine[-1]
        cosine.append(x * c - y * s)
        sine.append(x * s + y * c)
    return cosine, sine


def _legendre(z: Array, highest: int) -> dict[tuple[int, int], Array]:
    """Derivatives of order m of the Legendre polynomials, m up to l + 1."""
    table: dict[tuple[int, int], Array] = {}
    for m in range(highest + 2):
        diagonal = np.full_like(z, float(np.prod(np.arange(1, 2 * m, 2, dtype=float))))
        for degree in range(highest + 1):
            if degree < m:
                table[degree, m] = np.zeros_like(z)
            elif degree == m:
                table[degree, m] = diagonal
            else:
                before = table[degree - 2, m] if degree - 2 >= 0 else np.zeros_like(z)
                term = (2 * degree - 1) * z * table[degree - 1, m] - (degree + m - 1) * before
                table[degree, m] = term / (degree - m)
    return table


def _norm(degree: int, order: int) -> float:
    """The factor that makes a harmonic's mean square 1."""
    ratio = factorial(degree - order) / factorial(degree + order)
    return float(np.sqrt((2 * degree + 1) * ratio * (2 if order else 1)))
