"""Form factors of a large mesh as a hierarchical matrix: far blocks by few products, near ones as they are.

The exchange area a_i F_ij is symmetric, so each far block is kept once: its factors are rows at both of its
clusters, and a partner says which row of the other cluster belongs to a row. `compressed_factors` computes
them; memory and time grow like N log N.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from procam.arrays import Array, Array32, BoolArray, FloatArray, IndexArray
from procam.maths.mesh.clusters import Clusters, children
from procam.maths.mesh.cross_approximation import (
    MOST,
    LowRank,
    cross_approximation,
    recompressed,
)
from procam.maths.mesh.exchange import Exchange
from procam.maths.mesh.facets import Faces
from procam.threads import ThreadPool

TOLERANCE = 1e-3  # of a block
TRIALS = 4  # partners of each face by which a block is found to be hidden, or in part
ENTRIES = 1 << 19  # of factors, at a time
WORKERS = 2


@dataclass(frozen=True, slots=True)
class Level:
    """Far blocks between clusters of one level.

    Attributes
    ----------
    rows : (K, m) factors. starts : (2^l + 1,) first row of each cluster. partner : (K,) the row of the
        other cluster.
    """

    rows: Array32
    starts: IndexArray
    partner: IndexArray

    def add(self, light: Array32, result: Array32) -> None:
        """Add what the blocks make of light (2^l, m, C) to a result of that shape."""
        moments = np.empty((len(self.rows), light.shape[-1]), np.float32)
        for own, here in zip(self._of_clusters(), light, strict=True):
            np.matmul(self.rows[own], here, out=moments[own])
        moments = moments[self.partner]
        for own, cluster in zip(self._of_clusters(), range(len(result)), strict=True):
            result[cluster] += self.rows[own].T @ moments[own]

    def _of_clusters(self) -> Iterator[slice]:
        return (slice(a, b) for a, b in zip(self.starts[:-1], self.starts[1:], strict=True))


@dataclass(frozen=True, slots=True)
class Near:
    """Exchange areas of leaves that are near each other, or see a part of each other.

    Attributes
    ----------
    blocks : (K, m, m) [m^2], of slots of one leaf and of another or the same one, whose block is halved.
    starts : (2^depth + 1,) first block of each leaf, as the other. one : (K,) the first leaf.
    """

    blocks: Array32
    starts: IndexArray
    one: IndexArray

    def add(self, light: Array32, result: Array32) -> None:
        """Add what the blocks make of light (2^depth, m, C) to a result of that shape, either way."""
        leaves, slots, colours = light.shape
        for leaf in range(leaves):
            here = slice(self.starts[leaf], self.starts[leaf + 1])
            rows, one = self.blocks[here].reshape(-1, slots), self.one[here]
            result[leaf] += rows.T @ light[one].reshape(-1, colours)
            result[one] += (rows @ light[leaf]).reshape(-1, slots, colours)


@dataclass(frozen=True, slots=True)
class CompressedFactors:
    """Form factors between N faces, compressed.

    Attributes
    ----------
    area : (N,) [m^2]. face : (S,) of each slot of the tree; -1 for none. levels, near : blocks.
    """

    area: Array
    face: IndexArray
    levels: Sequence[Level]
    near: Near

    def gather(self, light: FloatArray) -> Array32:
        """F b (N, C): the mean over all directions of the light (N, C) that a face sees."""
        return np.asarray(self.exchange(light) / self.area[:, None], np.float32)

    def spread(self, light: FloatArray) -> Array32:
        """The transpose F^T b (N, C)."""
        return self.exchange(np.asarray(light / self.area[:, None], np.float32))

    def exchange(self, light: FloatArray) -> Array32:
        """The symmetric product (N, C) [m^2] with exchange areas."""
        used = self.face >= 0
        slots = np.zeros((len(self.face), light.shape[1]), np.float32)
        slots[used] = light[self.face[used]]
        result = np.zeros_like(slots)
        parts: list[Level | Near] = [*self.levels, self.near]
        for part in parts:
            shape = (len(part.starts) - 1, -1, light.shape[1])
            part.add(slots.reshape(shape), result.reshape(shape))
        out = np.empty((len(self.area), light.shape[1]), np.float32)
        out[self.face[used]] = result[used]
        return out

    @property
    def nbytes(self) -> int:
        """Memory of the factors."""
        return sum(level.rows.nbytes for level in self.levels) + self.near.blocks.nbytes


def compressed_factors(
    vertices: Array,
    faces: Faces,
    tolerance: float = TOLERANCE,
    progress: Callable[[float], None] = lambda share: None,
) -> CompressedFactors:
    """Form factors between the faces (N, 3) of a mesh, counter-clockwise seen from inside.

    Rows of a closed mesh sum to 1 as far as the quadrature and the tolerance allow; they are not scaled.
    `progress` is called with the share that is done.

    Raises
    ------
    InputError
        If the mesh is not convex and embreex is not installed.
    """
    exchange = Exchange(vertices, faces)
    tree = Clusters.of(exchange.corners, exchange.normal)
    pairs, levels = np.zeros((1, 2), np.intp), list[Level]()
    for depth in range(tree.depth + 1):
        far = tree.separated(depth, pairs)
        blocks = list(_far_blocks(exchange, tree.members(depth), pairs[far], tolerance))
        levels.append(_level(blocks, 2**depth, len(tree.face) >> depth))
        pairs = np.concatenate([pairs[~far], *(block.left for block in blocks)])
        if depth < tree.depth:
            pairs = children(pairs)
        progress((depth + 1) / (tree.depth + 2))
    near = _near(exchange, tree.members(tree.depth), pairs)
    progress(1.0)
    return CompressedFactors(exchange.area, tree.face, levels, near)


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Far blocks of pairs (B, 2) of clusters with their factors, and the pairs that must be divided."""

    pairs: IndexArray
    factors: LowRank
    left: IndexArray


def _far_blocks(
    exchange: Exchange, members: IndexArray, pairs: IndexArray, tolerance: float
) -> Iterator[_Blocks]:
    """Low-rank blocks of pairs (P, 2) of clusters, some at a time."""
    step = max(1, ENTRIES // (members.shape[1] * MOST))
    parts = [pairs[at : at + step] for at in range(0, len(pairs), step)]
    with ThreadPool(WORKERS) as pool:
        yield from pool.map(partial(_compressed, exchange, members, tolerance), parts)


def _compressed(
    exchange: Exchange, members: IndexArray, tolerance: float, pairs: IndexArray
) -> _Blocks:
    """Blocks of some pairs, and those of which a part is hidden, or whose rank is large."""
    dark, mixed = _seen(exchange, members, pairs)
    clear = pairs[~dark & ~mixed]
    rows, columns = members[clear[:, 0]], members[clear[:, 1]]
    area = exchange.area.astype(np.float32)

    def entries(block: IndexArray, i: IndexArray, j: IndexArray) -> Array32:
        """By the areas of both, so that small faces count as much as large ones."""
        here, there = rows[block[:, None], i], columns[block[:, None], j]
        return exchange.between(here, there, trace=False) / (area[here] * area[there])

    shape = (len(clear), members.shape[1], members.shape[1])
    found = cross_approximation(entries, shape, tolerance / 2)
    ended = found.ended
    kept = recompressed(found.some(ended), tolerance)
    kept.left[:] *= area[rows[ended]][:, None]
    kept.right[:] *= area[columns[ended]][:, None]
    return _Blocks(clear[ended], kept, np.concatenate([pairs[mixed], clear[~ended]]))


def _seen(
    exchange: Exchange, members: IndexArray, pairs: IndexArray
) -> tuple[BoolArray, BoolArray]:
    """Pairs of clusters that see nothing of each other, and those that see a part of each other.

    Every face is tried with some of the other cluster: a few may look through a gap where most do not.
    """
    count, slots = len(pairs), members.shape[1]
    rng = np.random.default_rng(count)
    own = np.broadcast_to(np.tile(np.arange(slots), TRIALS), (count, TRIALS * slots))
    other = rng.integers(slots, size=own.shape)
    here, there = np.concatenate([own, other], axis=1), np.concatenate([other, own], axis=1)
    first, second = members[pairs[:, :1], here], members[pairs[:, 1:], there]
    real = (first >= 0) & (second >= 0)
    seen = exchange.between(first, second) > 0
    some = np.asarray(seen.any(axis=1))
    return ~some, some & (seen < real).any(axis=1)


def _level(blocks: Sequence[_Blocks], clusters: int, slots: int) -> Level:
    """Factors of far blocks as rows of their clusters."""
    rows, owner = [np.zeros((0, slots), np.float32)], [np.zeros(0, np.intp)]
    partner, at = [np.zeros(0, np.intp)], 0
    for each in blocks:
        found = each.factors
        used = np.arange(found.left.shape[1]) < found.rank[:, None]
        rows += [found.left[used], found.right[used]]
        owner += [np.repeat(own, found.rank) for own in each.pairs.T]
        here = at + np.arange(found.rank.sum())
        partner += [here + len(here), here]
        at += 2 * len(here)
    whose = np.concatenate(owner)
    order = np.argsort(whose, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    starts = np.searchsorted(whose[order], np.arange(clusters + 1))
    return Level(np.concatenate(rows)[order], starts, place[np.concatenate(partner)[order]])


def _near(exchange: Exchange, members: IndexArray, pairs: IndexArray) -> Near:
    """Blocks of pairs (P, 2) of leaves; those of nothing are left out."""
    pairs = pairs[np.argsort(pairs[:, 1], kind="stable")]
    step = max(1, ENTRIES // members.shape[1] ** 2)
    parts = [pairs[at : at + step] for at in range(0, len(pairs), step)]
    with ThreadPool(WORKERS) as pool:
        which, blocks = zip(*pool.map(partial(_blocks, exchange, members), parts), strict=True)
    pairs = np.concatenate(which)
    starts = np.searchsorted(pairs[:, 1], np.arange(len(members) + 1))
    return Near(np.concatenate(blocks), starts, pairs[:, 0])


def _blocks(
    exchange: Exchange, members: IndexArray, pairs: IndexArray
) -> tuple[IndexArray, Array32]:
    first, second = members[pairs.T]
    block = exchange.between(first[:, :, None], second[:, None])
    block[pairs[:, 0] == pairs[:, 1]] /= 2
    lit = block.any(axis=(1, 2))
    return pairs[lit], block[lit]
