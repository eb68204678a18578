"""Solid angles of the cells of a grid of directions."""

from collections.abc import Iterable, Iterator

import numpy as np

from procam.arrays import Array
from procam.errors import InputError, ShapeError
from procam.kernels.areas import reference
from procam.kernels.native.arrays import check_like, plain, pointer
from procam.kernels.native.loader import chosen


def solid_angles(
    blocks: Iterable[Array], shape: tuple[int, int], *, out: Array | None = None
) -> Array:
    """Solid angles [sr] of a grid's cells from the unit directions of their corners, block by block.

    Each cell is two great-circle triangles (Van Oosterom & Strackee 1983,
    doi:10.1109/TBME.1983.325207), their triple products taken from edge differences; the true edges
    of a projector's pixels seen from elsewhere are small circles (docs/theory/geometry.md). Only one block
    and the last row of the one before are held at a time.

    Parameters
    ----------
    blocks : corner directions (n, W + 1, 3) float64, any n, from the top down; together H + 1 rows.
        One block with all rows will do.
    shape : (H, W) of the cells.
    out : (H, W) float64 to write to, instead of a new array.

    Returns
    -------
    (H, W) float64 [sr], unsigned; NaN where a corner is.

    Raises
    ------
    InputError
        If the blocks are not float64 (float32 does not resolve the corners of a pixel)
        or do not add up to H + 1 rows of W + 1 directions.

    Examples
    --------
    >>> import numpy as np
    >>> octant = np.array([[[0.0, 0, 1], [1, 0, 0]], [[0, 0, 1], [0, 1, 0]]])
    >>> print((solid_angles([octant], (1, 1)) / np.pi).round(12))
    [[0.5]]
    """
    height, width = shape
    areas = np.empty(shape) if out is None else out
    check_like(areas, np.broadcast_to(0.0, shape), np.float64, "out")
    if not (areas.flags.c_contiguous and areas.flags.aligned and areas.flags.writeable):
        raise InputError("out: a writable, contiguous, aligned array is needed")
    done = 0
    for rows in _overlapping(blocks, width):
        end = done + len(rows) - 1
        if end > height:
            raise InputError(f"blocks: {end} rows of cells or more were given; {height} are needed")
        _fill(rows, areas[done:end])
        done = end
    if done != height:
        raise InputError(f"blocks: {done} rows of cells were given; {height} are needed")
    return areas


def _overlapping(blocks: Iterable[Array], width: int) -> Iterator[list[Array]]:
    """The rows of each block, after the last row of the block before."""
    last: list[Array] = []
    for block in blocks:
        if block.ndim != 3 or block.shape[1:] != (width + 1, 3):
            raise ShapeError("blocks", block.shape, f"(n, {width + 1}, 3), W + 1 corners in a row")
        if block.dtype != np.float64:
            raise InputError(
                f"blocks: {block.dtype} is too coarse for the corners of pixels; float64 is needed"
            )
        rows = [*last, *(block if _readable(block) else plain(block))]
        if rows:
            yield rows
        last = rows[-1:]


def _readable(block: Array) -> bool:
    """Whether each row is contiguous and aligned."""
    return block.flags.aligned and block.strides[1:] == (24, 8)


def _fill(rows: list[Array], areas: Array) -> None:
    """Areas (n, W) between n + 1 rows of corners (W + 1, 3)."""
    native = chosen()
    if native is None:
        areas[...] = reference.solid_angles(np.stack(rows))
        return
    library, level, threads = native
    addresses = np.array([pointer(row) for row in rows], np.uintp)
    library.procam_areas(level, threads, *areas.shape, pointer(addresses), pointer(areas))
