"""The frame kernels in NumPy, in double precision: their reference implementation."""

from collections.abc import Iterator

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, Image
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.grid import BLOCK
from procam.kernels.frame.model import EVERYWHERE, FrameModel

ROWS = 64  # of the picture at a time


def monomials(direction: AnyArray, terms: int) -> Array:
    """1, x, y, z, xy, yz, xz, x^2 - y^2, z^2 (terms, ...) of (3, ...): the first 1, 4 or 9."""
    x, y, z = direction.astype(float)
    every = (np.ones_like(x), x, y, z, x * y, y * z, x * z, x * x - y * y, z * z)
    return np.stack(every[:terms])


def scattered_light(model: FrameModel, coefficients: Array, offset: Array | None) -> Image:
    """Polynomial times spread, plus the lamps, less the second polynomial (M, M, 3)."""
    terms = monomials(model.direction, model.terms)
    light = model.spread * np.tensordot(terms, coefficients[:, : model.terms], (0, 1))
    if model.ambient is not None:
        light += model.ambient
    if offset is not None:
        light -= np.tensordot(terms, offset[:, : model.terms], (0, 1))
    return light.astype(np.float32)


def interpolated(model: FrameModel, field: AnyArray, rows: slice) -> Array:
    """Rows of a field (M, M[, C]) at the size of the picture (R, N[, C])."""
    grid, nodes = model.grid, field.astype(float)
    above, below = nodes[grid.above[rows]], nodes[grid.below[rows]]
    down = grid.down[rows].astype(float).reshape(-1, *(1,) * (field.ndim - 1))
    return along_row(model, above + down * (below - above))


def along_row(model: FrameModel, rows: Array) -> Array:
    """Node rows (R, M[, C]) at the columns of the picture (R, N[, C])."""
    grid = model.grid
    left, right = rows[:, grid.left], rows[:, grid.right]
    across = grid.across.astype(float).reshape(1, -1, *(1,) * (rows.ndim - 2))
    return left + across * (right - left)


def frame_parts(
    model: FrameModel, image: AnyArray, light: Image, coding: Coding
) -> Iterator[tuple[slice, Array, Array, Array]]:
    """Rows, wanted light and its limits (R, N, 3), some rows at a time."""
    for start in range(0, model.size, ROWS):
        rows = slice(start, min(start + ROWS, model.size))
        content = coding.decoded(image[rows]).astype(float)
        if model.gain is not None:
            content *= interpolated(model, model.gain, rows)[..., None]
        lo = interpolated(model, model.lo, rows)
        hi = np.full_like(lo, coding.most(image.dtype))
        if model.hi is not None:
            hi = np.minimum(hi, interpolated(model, model.hi, rows))
        yield rows, content - interpolated(model, light, rows), lo, hi


def frame_sums(
    model: FrameModel, image: AnyArray, light: Image, what: str, coding: Coding
) -> Array:
    """Sums (3, terms) over the dome of weight times `what` times the monomials."""
    edges = {n: f.astype(float) for n, f in model.at_edges.items()}
    plain, weighed = np.zeros((2, len(model.grid.edges), model.size, 3))
    for rows, wanted, lo, hi in frame_parts(model, image, light, coding):
        sent = np.minimum(np.fmax(wanted, lo), hi)
        kept = {
            "light": sent,
            "content": wanted,
            "excess": sent - wanted,
            "at least": 1.0 * (wanted <= lo),
            "at most": 1.0 * (wanted >= hi),
        }[what]
        whole = _everywhere(model, rows)
        area = interpolated(model, model.solid_angle_sr, rows)[..., None]
        _share(model, plain, rows, np.where(whole, kept, 0))
        _share(model, weighed, rows, np.where(whole, 0, kept * area))
    moved = plain * along_row(model, edges["weight"])[..., None] + weighed
    if what == "excess":
        moved *= along_row(model, edges["edge_spread"])
    direction = along_row(model, np.moveaxis(edges["direction"], 1, 2))
    terms = monomials(np.moveaxis(direction, -1, 0), model.terms)
    return np.asarray(np.einsum("bnc,kbn->ck", moved, terms, optimize=True))


def _everywhere(model: FrameModel, rows: slice) -> BoolArray:
    """Which values (R, N, 3) lie in blocks of bands that are lit everywhere."""
    interval = np.searchsorted(model.grid.rows, np.arange(rows.start, rows.stop), "right") - 1
    each = np.repeat(model.lit[interval] == EVERYWHERE, BLOCK, axis=1)
    return each[:, : 3 * model.size].reshape(len(interval), model.size, 3)


def _share(model: FrameModel, edges: Array, rows: slice, kept: Array) -> None:
    """Split rows between the edges (E, N, 3) of their bands, by their distance from them."""
    along = model.grid.along[rows, None, None].astype(float)
    np.add.at(edges, model.grid.band[rows], kept * (1 - along))
    np.add.at(edges, model.grid.band[rows] + 1, kept * along)


def frame_apply(
    model: FrameModel, image: AnyArray, light: Image, coding: Coding, out: AnyArray
) -> None:
    """Write the light to send, encoded as the picture is."""
    for rows, wanted, lo, hi in frame_parts(model, image, light, coding):
        sent = np.minimum(np.fmax(wanted, lo), hi)
        sent[interpolated(model, model.solid_angle_sr, rows) <= 0] = 0
        out[rows] = coding.encoded(sent, image[rows], rows)
