"""A binary tree of clusters of faces, and the pairs of clusters that a hierarchical matrix stores.

All clusters of a level have the same number of slots: level l holds 2^l clusters of 2^(depth - l) leaves.
A slot without a face has index -1, at most one in each leaf.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, IndexArray

LEAF = 48  # faces of a leaf at most; half as many store as much, and are slower
# diameters of clusters over the distance between them, up to which their exchange has a low rank
SEPARATION = 1.5


@dataclass(frozen=True, slots=True)
class Clusters:
    """Faces in the order of the leaves of a tree.

    Attributes
    ----------
    depth : levels below the root. face : (S,) of each slot; -1 for none.
    low, high : by level, the corners (2^l, 3) of the box about each cluster [m].
    """

    depth: int
    face: IndexArray
    low: list[Array]
    high: list[Array]

    @classmethod
    def of(cls, corners: Array, normal: FloatArray, leaf: int = LEAF) -> "Clusters":
        """The tree of faces with corners (N, 3, 3) [m] and unit normals (N, 3).

        Clusters are halved along the longest side of the box about their centroids and their normals, these
        as long as the mesh: faces of two walls in one cluster would give a block a kink.
        """
        depth = max(0, int(np.ceil(np.log2(len(corners) / leaf))))
        parts = [np.arange(len(corners))]
        middle = corners.mean(axis=1)
        where = np.concatenate([middle, np.ptp(middle, axis=0).max() * normal], axis=1)
        for _ in range(depth):
            parts = [half for part in parts for half in _halves(part, where)]
        slots = max(map(len, parts))
        face = np.array([np.pad(p, (0, slots - len(p)), constant_values=-1) for p in parts])
        low = np.array([corners[p].min(axis=(0, 1)) for p in parts])
        high = np.array([corners[p].max(axis=(0, 1)) for p in parts])
        lows, highs = [low], [high]
        for _ in range(depth):
            lows.insert(0, np.minimum(lows[0][::2], lows[0][1::2]))
            highs.insert(0, np.maximum(highs[0][::2], highs[0][1::2]))
        return cls(depth, face.ravel(), lows, highs)

    def members(self, level: int) -> IndexArray:
        """Faces (2^l, slots) of the clusters of a level; -1 for none."""
        return self.face.reshape(2**level, -1)

    def separated(self, level: int, pairs: IndexArray) -> BoolArray:
        """Whether pairs (P, 2) of clusters of a level are far from each other for their size."""
        low, high = self.low[level], self.high[level]
        first, second = pairs.T
        gap = np.maximum(0, np.maximum(low[first] - high[second], low[second] - high[first]))
        across = np.linalg.norm(high - low, axis=1)[pairs].max(axis=1)
        return np.asarray(across <= SEPARATION * np.linalg.norm(gap, axis=1))


def _halves(part: IndexArray, where: Array) -> Iterator[IndexArray]:
    """Faces of a cluster on either side of their median along its longest side."""
    inside = where[part]
    along = inside[:, np.ptp(inside, axis=0).argmax()]
    order = np.argsort(along, kind="stable")
    count = -(-len(part) // 2)
    yield part[order[:count]]
    yield part[order[count:]]


def children(pairs: IndexArray) -> IndexArray:
    """Pairs (Q, 2) of clusters of the next level within pairs (P, 2) of I <= J, each once and I <= J."""
    steps = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    inside = (2 * pairs[:, None] + steps).reshape(-1, 2)
    return inside[inside[:, 0] <= inside[:, 1]]
