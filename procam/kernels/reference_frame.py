"""A dome master against the model of what bounces, as equations in NumPy: the twin of `frame`."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from procam.kernels.frame import Coding, FrameModel

Plane = NDArray[np.float32]
Double = NDArray[np.float64]
ROWS = 64  # of the picture at a time


def monomials(direction: NDArray[Any], terms: int) -> Double:
    """1, x, y, z, xy, yz, xz, x^2 - y^2, z^2 (terms, ...) of (3, ...): the first 1, 4 or 9."""
    x, y, z = direction.astype(float)
    every = (np.ones_like(x), x, y, z, x * y, y * z, x * z, x * x - y * y, z * z)
    return np.stack(every[:terms])


def bounced_light(model: "FrameModel", numbers: Double, offset: Double | None) -> Plane:
    """Polynomial times paint, lamps added and the second polynomial taken off (M, M, 3)."""
    terms = monomials(model.direction, model.terms)
    light = model.spread * np.tensordot(terms, numbers[:, : model.terms], (0, 1))
    if model.ambient is not None:
        light += model.ambient
    if offset is not None:
        light -= np.tensordot(terms, offset[:, : model.terms], (0, 1))
    return light.astype(np.float32)


def interpolated(model: "FrameModel", field: NDArray[Any], rows: slice) -> Double:
    """Rows of a field (M, M[, C]) at the size of the picture (R, N[, C])."""
    grid, nodes = model.grid, field.astype(float)
    above, below = nodes[grid.above[rows]], nodes[grid.below[rows]]
    down = grid.down[rows].astype(float).reshape(-1, *(1,) * (field.ndim - 1))
    return widened(model, above + down * (below - above))


def widened(model: "FrameModel", rows: Double) -> Double:
    """Node rows (R, M[, C]) at the columns of the picture (R, N[, C])."""
    grid = model.grid
    left, right = rows[:, grid.left], rows[:, grid.right]
    across = grid.across.astype(float).reshape(1, -1, *(1,) * (rows.ndim - 2))
    return left + across * (right - left)


def frame_parts(
    model: "FrameModel", image: NDArray[Any], light: Plane, coding: "Coding"
) -> Iterator[tuple[slice, Double, Double, Double]]:
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
    model: "FrameModel", image: NDArray[Any], light: Plane, what: str, coding: "Coding"
) -> Double:
    """Sums (3, terms) over the dome of weight times `what` times the monomials."""
    band, shape = model.grid.band, (len(model.weight), model.size, 3)
    total, count = np.zeros(shape), np.zeros(shape[:2])
    for rows, wanted, lo, hi in frame_parts(model, image, light, coding):
        sent = np.minimum(np.fmax(wanted, lo), hi)
        kept = {
            "light": sent,
            "content": wanted,
            "excess": sent - wanted,
            "at least": 1.0 * (wanted <= lo),
            "at most": 1.0 * (wanted >= hi),
        }[what]
        lit = interpolated(model, model.coverage, rows) > 0
        np.add.at(total, band[rows], kept * lit[..., None])
        np.add.at(count, band[rows], lit)
    weight = np.moveaxis(model.painted, 1, -1) if what == "excess" else model.weight[..., None]
    means = total / np.maximum(count, 1)[..., None] * widened(model, weight.astype(float))
    axes = [widened(model, model.middle[:, k].astype(float)) for k in range(3)]
    terms = monomials(np.stack(axes), model.terms)
    return np.asarray(np.einsum("bnc,kbn->ck", means, terms, optimize=True))


def frame_apply(
    model: "FrameModel", image: NDArray[Any], light: Plane, coding: "Coding", out: NDArray[Any]
) -> None:
    """Write the light to send, encoded as the picture is."""
    for rows, wanted, lo, hi in frame_parts(model, image, light, coding):
        sent = np.minimum(np.fmax(wanted, lo), hi)
        sent[interpolated(model, model.coverage, rows) <= 0] = 0
        out[rows] = coding.encoded(sent, image[rows], rows)
