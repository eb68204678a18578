"""Form factors between flat polygons by contour integrals (Sparrow 1963, doi:10.1115/1.3686058).

A_a F_ab = 1/(2 pi) times the double integral of ln(r) over both contours. The inner integral along a
straight edge has a closed form; the outer one is a quadrature.
"""

import numpy as np

from procam.arrays import Array, BoolArray

NODES = 4  # along an edge, for pairs that do not touch
FINE_NODES = 24  # for pairs that touch, where the integrand has a cusp at the ends of the edge
TOUCHING = 1e-9  # of the extent: distance of corners that count as one
BLOCK = 4096  # pairs at a time


def exchange_areas(first: Array, second: Array) -> Array:
    """Area times form factor (P,) [m^2] between polygons (P, K, 3) and (P, L, 3) [m].

    Each is counter-clockwise as seen from the other and lies wholly in front of the other's plane.

    >>> square = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]])
    >>> facing = np.array([[[0.0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]]])
    >>> print(exchange_areas(square, facing).round(4))
    [0.1998]
    """
    touching = _touch(first, second)
    result = np.empty(len(first))
    for which, rule in ((~touching, _gauss(NODES)), (touching, _clustered(FINE_NODES))):
        (pairs,) = np.nonzero(which)
        for at in range(0, len(pairs), BLOCK):
            some = pairs[at : at + BLOCK]
            result[some] = _contour_integral(first[some], second[some], *rule)
    return np.maximum(result, 0.0)


def _gauss(count: int) -> tuple[Array, Array]:
    """Nodes and weights of Gauss-Legendre quadrature on [0, 1]."""
    node, weight = np.polynomial.legendre.leggauss(count)
    return (node + 1) / 2, weight / 2


def _clustered(count: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes moved towards both ends by a polynomial, for integrands like s ln(s)."""
    node, weight = _gauss(count)
    return node**3 * (10 - 15 * node + 6 * node**2), weight * 30 * (node * (1 - node)) ** 2


def _touch(first: Array, second: Array) -> BoolArray:
    """Whether two polygons share a corner."""
    apart = np.linalg.norm(first[:, :, None] - second[:, None], axis=-1).min(axis=(1, 2))
    extent = np.linalg.norm(first - first[:, :1], axis=-1).max(axis=1)
    return np.asarray(apart < TOUCHING * extent)


def _contour_integral(first: Array, second: Array, node: Array, weight: Array) -> Array:
    """The double integral over the contours of pairs (P, K, 3), (P, L, 3)."""
    start, edge = second[:, None, None], (np.roll(second, -1, axis=1) - second)[:, None, None]
    side = np.roll(first, -1, axis=1) - first
    along = np.einsum("pki,pli->pkl", side, edge[:, 0, 0])
    length = np.linalg.norm(edge, axis=-1)
    point = first[:, :, None] + node[:, None] * side[:, :, None]  # (P, K, nodes, 3)
    inner = _log_along(point[:, :, :, None] - start, edge / length[..., None], length)
    return np.einsum("pknl,n,pkl->p", inner / length, weight, along) / (2 * np.pi)


def _log_along(offset: Array, unit: Array, length: Array) -> Array:
    """Integral of ln(distance) along a straight edge, from points at `offset` from its start."""
    ahead = np.sum(offset * unit, axis=-1)
    aside2 = np.maximum(np.sum(offset * offset, axis=-1) - ahead * ahead, 0.0)
    aside = np.sqrt(aside2)

    def primitive(s: Array) -> Array:
        square = np.maximum(aside2 + s * s, 1e-300)
        turn = np.arctan2(s, np.maximum(aside, 1e-150))
        return 0.5 * s * np.log(square) - s + aside * turn

    return np.asarray(primitive(length - ahead) - primitive(-ahead))
