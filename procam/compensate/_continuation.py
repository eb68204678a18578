"""Continuation of fields beyond the lit part of a dome, where interpolation at its border reads."""

from dataclasses import replace
from typing import Any

import numpy as np

from procam.arrays import BoolArray, IndexArray, Map
from procam.kernels.frame import FrameModel
from procam.kernels.frame.model import zeros_to_pad

WELL_LIT = 0.5  # least coverage of a node whose measured light is used
REACH = 6  # nodes to continue beyond that: the width of a fading border and of a band of node rows
CONTINUED = ("spread", "lo", "hi", "gain")
CHANNELS = 3
AROUND = np.array([(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1)]).T


def continued(model: FrameModel) -> FrameModel:
    """A model whose fields are continued for some nodes beyond the well lit part, for interpolation.

    Faintly lit nodes further out keep their values and are continued in turn; unlit nodes beyond are 0.
    """
    lit, given = model.coverage > 0, {n: getattr(model, n) for n in CONTINUED}
    lit_colours = np.repeat(lit.ravel(), CHANNELS).reshape(*lit.shape, CHANNELS)
    fields: dict[str, Any] = {n: zeros_to_pad(f.shape) for n, f in given.items() if f is not None}
    for name, field in fields.items():
        np.copyto(field, given[name], where=lit if field.ndim == 2 else lit_colours)
    flat = {name: field.reshape(lit.size, -1) for name, field in fields.items()}
    known = _spread_out(flat, model.coverage >= WELL_LIT)
    if (lit & ~known).any():
        _spread_out(flat, known | lit)
    return replace(model, **fields)


def _spread_out(fields: dict[str, Map], known: BoolArray) -> BoolArray:
    """Continue fields (M * M, C) ring by ring beyond known nodes (M, M); returns all that are known then."""
    known = known.copy()
    beside = _grown(known)
    for _ in range(REACH):
        at = np.flatnonzero(beside & ~known)
        near, share = _around(at, known)
        for field in fields.values():
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
