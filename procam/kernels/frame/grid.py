"""Positions of the pixels of a dome master among the nodes of coarser fields.

Fields of a dome are smooth, so they are kept at M x M nodes and interpolated bilinearly to the N x N
pixels of a picture, M <= N. Everything about that which depends on M and N alone is computed here once:
the nodes around each pixel and their weights, and which blocks of the picture are lit.
"""

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, BoolArray, Map

Index = NDArray[np.int32]
CHANNELS = 3
POSITIONS = ("values", "shared")  # as in struct procam_frame
STRIP, BLOCK = 1536, 64  # as in frame/cell.h
FINE = 256  # nodes from which on a band may have more than one interval
STRAIGHT = (
    2e-5  # of the greatest area: how far one may lie off the line between the edges of a band
)
STEEP = 8e-3  # of the greatest area: how much it may change over a band; directions change too
SMOOTH = 3e-4  # of the greatest value: largest second difference that a parabola describes


class Grid:
    """Positions of the pixels of a picture of `size` among `nodes`: half-pixel centres, edges clamped.

    Row y lies between node rows above[y] and below[y], at the fraction down[y]; columns
    alike: left, right, across. Pairs of node rows are intervals; `rows` holds the first row of each.
    `shared` intervals make a band, from the node row of one edge to that of the next (`edges`; the
    first and the last lie outside the nodes). `band` is that of each row of the picture, `along` its
    position in the band, 0..1.
    """

    def __init__(self, size: int, nodes: int) -> None:
        self.size, self.nodes = size, nodes
        place = (np.arange(size) + 0.5) * nodes / size - 0.5
        first = np.floor(place).astype(np.int32)
        self.above = self.left = np.maximum(first, 0)
        self.below = self.right = np.minimum(first + 1, nodes - 1)
        self.down = self.across = (place - first).astype(np.float32)
        self.shared = min(4, 2 ** max(0, (nodes // FINE).bit_length() - 1))
        self.band, order = np.divmod(first + 1, self.shared)
        self.along = ((order + self.down) / self.shared).astype(np.float32)
        self.edges = np.arange(0, nodes + 1 + self.shared, self.shared) - 1
        self.rows = np.searchsorted(first + 1, np.arange(nodes + 2)).astype(np.int32)
        self._positions: dict[int, dict[str, dict[str, AnyArray]]] = {}

    def positions(self, lanes: int) -> dict[str, dict[str, AnyArray]]:
        """Nodes around the interleaved values of a row, in vectors of `lanes`.

        `values`: in fields of three interleaved colours; `shared`: in fields of one. `start` is the
        first node of each vector, `left` that of each element, counted from there; the right one
        follows it. `across` is the weight of the right one.
        """
        if lanes not in self._positions:
            padded = -(-self.size // BLOCK) * BLOCK
            pixel = np.minimum(np.arange(padded), self.size - 1)
            left = np.minimum(self.left, max(0, self.nodes - 2))[pixel]
            across = np.where(self.left == self.right, self.left > left[: self.size], self.across)[
                pixel
            ]
            value, colour = np.divmod(np.arange(CHANNELS * padded), CHANNELS)
            self._positions[lanes] = {
                "values": _from_starts(CHANNELS * left[value] + colour, across[value], lanes),
                "shared": _from_starts(left[value], across[value], lanes),
            }
        return self._positions[lanes]

    def at_edges(self, field: Map) -> Map:
        """A field (M, ...) at edges (E, ...); lines between them have the means of a smooth field."""
        last = len(field) - 1
        found = field[np.clip(self.edges, 0, last)].astype(np.float32, copy=False)
        for k in np.flatnonzero((self.edges < 0) | (self.edges > last)) if last else ():
            end, before = (0, 1) if self.edges[k] < 0 else (last, last - 1)
            slope = found[k] - field[before].astype(np.float32)
            found[k] += abs(self.edges[k] - end) * slope
        bend = found[2:] + found[:-2] - 2 * found[1:-1]
        bend *= np.abs(bend) <= SMOOTH * np.abs(found).max()
        bend *= (1 - self.shared**-2) / 12
        found[1:-1] -= bend
        return found

    def lit(self, area: Map) -> NDArray[np.uint8]:
        """How blocks of values in intervals (M + 1, blocks) are summed: 0, 1, 2.

        0: unlit. 1: partly lit, with the solid angle of each pixel. 2: lit all over their band, with
        solid angles linear between its edges.
        """
        none = self.least(~(area > 0))
        every = self.least((area > 0) & ~self._bent(area))
        pair = np.arange(len(area) + 1)
        whole = np.logical_and.reduceat(every, pair[:: self.shared])[pair // self.shared]
        return np.ascontiguousarray((~none).astype(np.uint8) + whole)

    def least(self, field: AnyArray) -> AnyArray:
        """The least of a field (M, M[, C]) at the nodes that blocks of values in intervals lie between."""
        padded = -(-CHANNELS * self.size // BLOCK) * BLOCK
        pixel = np.minimum(np.arange(padded), CHANNELS * self.size - 1) // CHANNELS
        numbers = field.reshape(len(field), -1)
        each = numbers.shape[1] // len(field)
        first = each * self.left[pixel][::BLOCK]
        last = each * self.right[pixel][BLOCK - 1 :: BLOCK] + each - 1
        low = np.minimum.reduceat(numbers, np.stack([first, last], axis=1).ravel(), axis=1)[:, ::2]
        low = np.minimum(low, numbers[:, last])  # which reduceat leaves out
        return np.concatenate([low[:1], np.minimum(low[:-1], low[1:]), low[-1:]])

    def _bent(self, area: Map) -> BoolArray:
        """Nodes (M, M) whose area does not lie near a flat line between the edges of their band."""
        edges, most = self.at_edges(area), area.max()
        rise = np.diff(edges, axis=0)
        steep = np.abs(rise) > STEEP * most
        bent = np.empty(area.shape, bool)
        for order in range(self.shared):  # node rows in a band, from its edge on
            rows = slice((order - 1) % self.shared, None, self.shared)
            bands = slice(int(order == 0), int(order == 0) + len(area[rows]))
            off = area[rows] - edges[bands] - np.float32(order / self.shared) * rise[bands]
            bent[rows] = steep[bands] | (np.abs(off) > STRAIGHT * most)
        return bent


def _from_starts(left: Index, across: Map, lanes: int) -> dict[str, AnyArray]:
    """`left` counted from the least of each vector; with M <= N all of a vector's lie within `lanes`."""
    start = left.reshape(-1, lanes).min(axis=1).astype(np.int32)
    from_there = np.ascontiguousarray(left - np.repeat(start, lanes), np.int32)
    assert from_there.max() < lanes
    return {"start": start, "left": from_there, "across": np.ascontiguousarray(across, np.float32)}
