"""Least squares in many small groups at once, from samples that come a part at a time."""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array, FloatArray, IndexArray


class NormalEquations:
    """Weighted least squares of two values on T terms in each of G groups."""

    def __init__(self, terms: int, groups: int) -> None:
        self._normal, self._right = np.zeros((groups, terms, terms)), np.zeros((groups, terms, 2))

    def add(
        self, index: IndexArray, terms: Sequence[Array], values: FloatArray, weight: Array
    ) -> None:
        """Add samples: their groups (n,), T terms (n,), values (n, 2) and weights (n,)."""
        groups = len(self._normal)
        for i, term in enumerate(terms):
            weighted = weight * term
            for j in range(i, len(terms)):
                self._normal[:, i, j] += np.bincount(index, weighted * terms[j], groups)
            for j in range(2):
                self._right[:, i, j] += np.bincount(index, weighted * values[:, j], groups)

    def solved(self) -> tuple[Array, Array]:
        """Factors of the terms (G, T, 2), and inverses of the normal matrices (G, T, T)."""
        upper, count = np.triu(self._normal), self._normal.shape[1]
        normal = upper + np.swapaxes(np.triu(upper, 1), 1, 2)
        scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
        unit = normal / scale[:, :, None] / scale[:, None, :] + 1e-9 * np.eye(count)
        inverse = np.linalg.inv(unit) / scale[:, :, None] / scale[:, None, :]
        return inverse @ self._right, inverse
