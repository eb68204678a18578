"""Where the pixels of a dome master lie among the nodes of coarser fields."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float32]
Index = NDArray[np.int32]
CHANNELS = 3
PLACES = ("values", "shared", "pixels")  # as in struct procam_frame
STRIP, BLOCK, STEP = 1536, 64, 16  # as in frame/cell.h
FINE = 256  # nodes from which on bands may have more intervals than one
STRAIGHT = 2e-5  # of the greatest area: how far one may be from the line between edges of a band
STEEP = 8e-3  # the same: how much that may rise; directions change too
SMOOTH = 3e-4  # of the greatest value: second differences of what a parabola does for


class Grid:
    """Where the pixels of a picture of `size` lie among `nodes`: half-pixel centres, edges clamped.

    Row y lies between node rows above[y] and below[y], down[y] of the way; columns alike: left,
    right, across. Pairs of node rows are intervals; `rows` holds the first row of each. `shared` of
    them make a band, from the node row of one edge to that of the next (`edges`, the first and the last
    outside the nodes); `band` is that of each row of the picture, `along` how far down there it lies.
    """

    def __init__(self, size: int, nodes: int) -> None:
        self.size = size
        place = (np.arange(size) + 0.5) * nodes / size - 0.5
        first = np.floor(place).astype(np.int32)
        self.above = self.left = np.maximum(first, 0)
        self.below = self.right = np.minimum(first + 1, nodes - 1)
        self.down = self.across = (place - first).astype(np.float32)
        self.shared = min(4, 2 ** max(0, (nodes // FINE).bit_length() - 1))
        self.band, order = np.divmod(first + 1, self.shared)
        self.along = (order + self.down) / self.shared
        self.edges = np.arange(0, nodes + 1 + self.shared, self.shared) - 1
        self.rows = np.searchsorted(first + 1, np.arange(nodes + 2)).astype(np.int32)
        padded = -(-CHANNELS * size // BLOCK) * BLOCK
        value = np.minimum(np.arange(padded), CHANNELS * size - 1)
        pixel, channel = value // CHANNELS, value % CHANNELS
        left, right, across = self.left[pixel], self.right[pixel], self.across[pixel]
        rest = [_padded(numbers) for numbers in (self.left, self.right, self.across)]
        self.places = {
            "values": _places(CHANNELS * left + channel, CHANNELS * right + channel, across),
            "shared": _places(left, right, across),
            "pixels": _places(rest[0], rest[1], rest[2]),
        }

    def at_edges(self, field: NDArray[Any]) -> NDArray[np.float64]:
        """A field (M, ...) at edges (E, ...), so that lines between them keep a smooth one's means."""
        last = len(field) - 1
        found = field[np.clip(self.edges, 0, last)].astype(float)
        for k in np.flatnonzero((self.edges < 0) | (self.edges > last)) if last else ():
            end, before = (0, 1) if self.edges[k] < 0 else (last, last - 1)
            slope = (field[end].astype(float) - field[before]) / (end - before)
            found[k] += (self.edges[k] - end) * slope
        bend = found[2:] - 2 * found[1:-1] + found[:-2]
        bend[np.abs(bend) > SMOOTH * np.abs(found).max()] = 0
        bend *= (1 - self.shared**-2) / 12
        found[1:-1] -= bend
        return np.asarray(found)

    def lit(self, area: Plane) -> NDArray[np.uint8]:
        """How blocks of values in intervals (M + 1, blocks) are summed: 0, 1, 2.

        0: they are not lit. 1: pixel by pixel. 2: with areas on lines between the edges of their band, all
        of which is lit.
        """
        some = -self.least(-area) > 0
        every = self.least(np.where(self._bent(area), 0, area)) > 0
        pair = np.arange(len(area) + 1)
        whole = np.logical_and.reduceat(every, pair[:: self.shared])[pair // self.shared]
        return np.ascontiguousarray(some.astype(np.uint8) + whole)

    def least(self, field: Plane) -> Plane:
        """The least of a field (M, M) at the nodes that blocks of values in intervals lie between."""
        last = len(field) - 1
        pair = np.arange(len(field) + 1)
        low = np.minimum(field[np.maximum(pair - 1, 0)], field[np.minimum(pair, last)])
        padded = -(-CHANNELS * self.size // BLOCK) * BLOCK
        pixel = np.minimum(np.arange(padded), CHANNELS * self.size - 1) // CHANNELS
        left, right = self.left[pixel][::BLOCK], self.right[pixel][BLOCK - 1 :: BLOCK]
        spans = np.stack([left, right + 1], axis=1).ravel()
        wide = np.pad(low, ((0, 0), (0, 1)), "edge")
        return np.asarray(np.minimum.reduceat(wide, spans, axis=1)[:, ::2], np.float32)

    def _bent(self, area: Plane) -> NDArray[np.bool_]:
        """Nodes (M, M) whose area does not lie on a gentle line between the edges of their band."""
        band, order = np.divmod(np.arange(len(area)) + 1, self.shared)
        edges, most = self.at_edges(area).astype(np.float32), area.max()
        rise = np.diff(edges, axis=0)[band]
        off = area - edges[band] - (order / self.shared).astype(np.float32)[:, None] * rise
        return np.asarray((np.abs(off) > STRAIGHT * most) | (np.abs(rise) > STEEP * most))


def _places(left: Index, right: Index, across: Plane) -> dict[str, NDArray[Any]]:
    """Where numbers lie among the nodes: `start` of each STEP of them, and from there `pair`.

    `pair` holds the node to the left, and that to the right << 8; `across` is the share of that. Starts
    within a BLOCK are the same if two vectors from there hold all of it.
    """
    starts = [_least_of(left, many) for many in (BLOCK, STEP)]
    start = next(s for s in starts if (right - s < 2 * STEP).all())  # one is, with M <= N
    found = {"start": start[::STEP], "pair": left - start | (right - start) << 8}
    places: dict[str, NDArray[Any]] = {
        n: np.ascontiguousarray(f, np.int32) for n, f in found.items()
    }
    return places | {"across": np.ascontiguousarray(across, np.float32)}


def _least_of(numbers: Index, many: int) -> Index:
    """The least of every so many numbers, for each of them."""
    return np.repeat(numbers.reshape(-1, many).min(axis=1), many)


def _padded(numbers: NDArray[Any]) -> NDArray[Any]:
    """As many as whole strips of pixels have, the last one again and again."""
    return np.pad(numbers, (0, -len(numbers) % (STRIP // CHANNELS)), "edge")
