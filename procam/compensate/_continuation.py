"""Continuation of fields beyond the lit part of a dome, where interpolation at its border reads."""

from collections.abc import Sequence

import numpy as np

from procam.arrays import BoolArray, IndexArray, Map
from procam.kernels.frame.model import zeros_to_pad

WELL_LIT = 0.5  # least coverage of a node whose measured light is used
REACH = 6  # nodes to continue beyond that: the width of a fading border and of a band of node rows
AROUND = np.array([(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)]).T


def lit_part(field: Map, lit: BoolArray) -> Map:
    """A copy of a field where `lit`, of its shape, and 0 elsewhere; made as the frame kernels read it."""
    found = zeros_to_pad(field.shape)
    np.copyto(found, field, where=lit)
    return found


def continue_fields(fields: Sequence[Map], coverage: Map) -> None:
    """Continue fields (M, M[, C]) in place for some nodes beyond the well lit part, for interpolation.

    Faintly lit nodes further out keep their values and are continued in turn; unlit nodes beyond are 0.
    """
    flat = [field.reshape(coverage.size, -1) for field in fields]
    lit, known = coverage > 0, _spread_out(flat, coverage >= WELL_LIT)
    if (lit & ~known).any():
        _spread_out(flat, known | lit)


def _spread_out(fields: Sequence[Map], known: BoolArray) -> BoolArray:
    """Continue fields (M * M, C) ring by ring beyond known nodes (M, M); returns all that are known then."""
    known = known.copy()
    beside = _grown(known)
    for _ in range(REACH):
        at = np.flatnonzero(beside & ~known)
        near, share = _around(at, known)
        for field in fields:
            field[at] = np.einsum("pn,pnc->pc", share, np.take(field, near, axis=0))
        known.ravel()[at] = True
        beside = np.zeros_like(known)
        beside.ravel()[near] = True
    return known


def _around(at: IndexArray, known: BoolArray) -> tuple[IndexArray, Map]:
    """The nine nodes (P, 9) around each of some nodes (P,), and their weights (P, 9): of unknown ones 0."""
    edge = len(known)
    y, x = (n[:, None] + step for n, step in zip(np.divmod(at, edge), AROUND, strict=True))
    near = np.clip(y, 0, edge - 1) * edge + np.clip(x, 0, edge - 1)
    inside = (np.minimum(x, y) >= 0) & (np.maximum(x, y) < edge)
    share = (known.ravel()[near] & inside).astype(np.float32)
    return near, share / share.sum(axis=1, keepdims=True)


def _grown(mask: BoolArray) -> BoolArray:
    """A mask grown by one node, at corners too."""
    wide = np.pad(mask, 1)
    tall = wide[:-2] | wide[1:-1] | wide[2:]
    return np.asarray(tall[:, :-2] | tall[:, 1:-1] | tall[:, 2:])
