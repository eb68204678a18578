"""Adaptive cross approximation of many blocks at a time (Bebendorf 2000, doi:10.1007/PL00005410).

A block A (m, n) is the sum of few outer products u v^T of its own columns and rows: of those through the
largest entry of the row before. Each block ends when a product is small beside the block's norm.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from procam.arrays import Array32, BoolArray, IndexArray

MOST = 20  # products; a block that needs more has a kink, and is better divided
Entries = Callable[[IndexArray, IndexArray, IndexArray], Array32]


class LowRank(NamedTuple):
    """Factors (B, K, m) and (B, K, n) of B blocks, 0 beyond the rank (B,) of each; which ones ended."""

    left: Array32
    right: Array32
    rank: IndexArray
    ended: BoolArray

    def some(self, which: BoolArray) -> "LowRank":
        """Those of some blocks."""
        return LowRank(self.left[which], self.right[which], self.rank[which], self.ended[which])


def cross_approximation(entries: Entries, shape: tuple[int, int, int], tolerance: float) -> LowRank:
    """Low-rank factors of blocks (B, m, n) whose `entries` are computed when they are asked for.

    `entries(b, i, j)` gives those of blocks b (A,), rows i (A, r) and columns j (A, c), where r or c is 1.
    `tolerance` is relative to the norm of each block.
    """
    count, m, n = shape
    left, right = (np.zeros((count, MOST, size), np.float32) for size in (m, n))
    rank, norm2 = np.zeros(count, np.intp), np.zeros(count)
    ended, used = np.zeros(count, bool), np.zeros((count, m), bool)
    row = np.zeros(count, np.intp)
    at = np.arange(count)  # blocks that go on
    for _ in range(2 * MOST):
        k = rank[at]
        across = entries(at, row[at, None], np.arange(n)[None])
        across -= np.einsum("ak,akn->an", _at(left, at, row[at]), right[at])
        used[at, row[at]] = True
        column = np.abs(across).argmax(axis=1)
        pivot = across[np.arange(len(at)), column]
        some = np.abs(pivot) > 0
        row[at[~some]] = used[at[~some]].argmin(axis=1)  # a row of nothing: the next
        dead = at[used[at].all(axis=1)]
        ended[dead] = True
        at, k, across, column, pivot = (each[some] for each in (at, k, across, column, pivot))
        down = entries(at, np.arange(m)[None], column[:, None])
        down -= np.einsum("ak,akm->am", _at(right, at, column), left[at])
        down /= pivot[:, None]
        new2 = _square(down) * _square(across)
        dot = np.einsum("akm,am->ak", left[at], down) * np.einsum("akn,an->ak", right[at], across)
        norm2[at] += 2 * dot.sum(axis=1) + new2
        left[at, k], right[at, k] = down, across
        rank[at] += 1
        ended[at] |= new2 <= tolerance**2 * norm2[at]
        row[at] = np.where(used[at], -1, np.abs(down)).argmax(axis=1)
        at = np.flatnonzero(~ended & (rank < MOST))
        if not len(at):
            break
    return LowRank(left, right, rank, ended)


def _at(factors: Array32, block: IndexArray, where: IndexArray) -> Array32:
    """Column (A, K) of the factors of blocks (A,) at a row or column (A,) of each."""
    return factors[block, :, where]


def _square(vectors: Array32) -> Array32:
    return np.einsum("an,an->a", vectors, vectors)


def recompressed(found: LowRank, tolerance: float) -> LowRank:
    """The same blocks by as few products as the tolerance allows, from a singular value decomposition."""
    (q, r), (p, s) = (np.linalg.qr(np.swapaxes(f, 1, 2)) for f in (found.left, found.right))
    u, size, v = np.linalg.svd(r @ np.swapaxes(s, 1, 2))
    tail = np.cumsum(size[:, ::-1] ** 2, axis=1)[:, ::-1]
    rank = np.sum(tail > tolerance**2 * tail[:, :1], axis=1)
    kept = np.arange(size.shape[1]) < rank[:, None]
    root = np.where(kept, np.sqrt(size), 0)[..., None]
    left = root * np.swapaxes(q @ u, 1, 2)
    right = root * (v @ np.swapaxes(p, 1, 2))
    return LowRank(left, right, rank, found.ended)
