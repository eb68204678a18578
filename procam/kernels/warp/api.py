"""Frames of a projector from a dome master of direct light.

`plan_warp` packs what is fixed for a projector, its position in the master, black and blend per pixel, in
20 bytes per pixel and in the order in which the kernel reads it. `warp_frame` then makes a frame in one
pass: sample, subtract black, blend, unmix colours, look up the drive, dither.
"""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from procam.arrays import AnyArray, Array, Array32, FloatArray
from procam.errors import InputError, ShapeError
from procam.kernels.native.arrays import KINDS, aligned_empty, bytes_of_floats, plain, pointer
from procam.kernels.native.loader import chosen
from procam.kernels.warp import reference
from procam.kernels.warp.reference import BAND, BLOCK, KNOTS, PACKED, PLACE, STRIP, TILE, WarpPlan

MASTER_KINDS = {**KINDS, np.dtype(np.float16): 3}
CODES = 256
MOST_EDGE = 2**24  # beyond that, float32 does not count pixels
LEAST_EDGE, MOST_PIXELS = 2, (2**31 - 1) // 3
WHOLE = {np.dtype(np.uint8): 255 * 256, np.dtype(np.uint16): 65535}  # full drive in a table


class _Warp(ctypes.Structure):
    """`struct procam_warp` of native/kernels.h."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("kind", "out_kind")),
        *((name, ctypes.c_size_t) for name in ("rows", "columns", "master_rows", "master_columns")),
        ("unit", ctypes.c_float),
        *(
            (name, ctypes.c_void_p)
            for name in ("master", "blocks", "decode", "decode_bytes", "unmix")
        ),
        *((name, ctypes.c_void_p) for name in ("drives", "thresholds", "out")),
    )


def plan_warp(
    place: FloatArray,
    black: FloatArray,
    share: FloatArray,
    unmix: ArrayLike,
    *,
    drives: ArrayLike | None = None,
    decode: ArrayLike | None = None,
    thresholds: ArrayLike | None = None,
) -> WarpPlan:
    """The plan of one projector: everything that does not change from frame to frame.

    Places, blacks and shares are kept to 1/131070 of their range within 16 pixels of a row.

    Parameters
    ----------
    place : (H, W, 2) where each pixel lands in the master, (column, row) [px].
    black : (H, W, 3) light that is there already [rel].
    share : (H, W, 3) of the light asked for beyond that, what this projector's primaries must send,
        1 for full drive; a pixel with a number that is not finite sends nothing.
    unmix : (3, 3) inverse of the colour mixing.
    drives : (513, 3) drives 0..1, rising, for light of KNOTS; None for light itself.
    decode : (256,) light of the codes of 8-bit masters [rel]; None for code / 255.
    thresholds : (64, 64) in [0, 1) of the dither of 8-bit frames; None for 1/2, which rounds.

    Raises
    ------
    InputError
        If shapes do not fit, a share is negative, drives do not rise or thresholds leave [0, 1).
    """
    shape = place.shape[:2]
    for name, array, last in (("place", place, 2), ("black", black, 3), ("share", share, 3)):
        if array.shape != (*shape, last):
            raise ShapeError(name, array.shape, f"({', '.join(map(str, shape))}, {last})")
    if (share < 0).any():
        raise InputError(f"share: the least is {np.nanmin(share):.3g}; none may be below 0")
    light = np.arange(CODES) / (CODES - 1) if decode is None else decode
    codes = _table("decode", light, (CODES,))
    tile = np.full((TILE, TILE), 0.5) if thresholds is None else thresholds
    blocks = np.empty(
        (-(-shape[0] // BAND), -(-shape[1] // TILE), TILE // STRIP, BAND, STRIP // BLOCK), PACKED
    )
    for band, packed in enumerate(blocks):
        rows = slice(band * BAND, (band + 1) * BAND)
        _pack([part[rows] for part in (place, black, share)], packed)
    return WarpPlan(
        (shape[0], shape[1]),
        blocks,
        _table("unmix", unmix, (3, 3)).astype(np.float32),
        codes.astype(np.float32),
        None if drives is None else _rising(drives),
        _thresholds(tile),
    )


def warp_frame(
    master: AnyArray, plan: WarpPlan, out: AnyArray | None = None, dtype: Any = np.uint8
) -> AnyArray:
    """The frame of one projector for a dome master of direct light.

    The master is decoded and sampled bilinearly (0 outside it); black is subtracted, the share of the
    blend applied, colours unmixed, the result clipped to 0..1. Float32 frames hold that light, others
    the drive that gives it: uint16 rounded, uint8 dithered, floor(255 drive + threshold).

    Parameters
    ----------
    master : (N, M, 3) uint8, encoded as the plan's `decode` says, or linear light: uint16, of which
        65535 is 1, float16 or float32 [rel]. What NaN or infinite light touches is dark.
    plan : made by `plan_warp`; with drives, unless the frame is float32.
    out : (H, W, 3) to write to, instead of a new array. Its type overrides `dtype`.
    dtype : of a new frame, uint8, uint16 or float32.

    Returns
    -------
    (H, W, 3) frame. C differs from NumPy by the rounding of float32 places.

    Raises
    ------
    InputError
        If types or shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> place = np.array([[[0.5, 0.0], [1.0, 1.0]]])
    >>> plan = plan_warp(place, np.zeros((1, 2, 3)), np.full((1, 2, 3), 0.5), np.eye(3))
    >>> master = np.array([[[0, 0, 0], [1, 1, 1]], [[0, 0, 0], [0, 0.5, 1]]], np.float32)
    >>> warp_frame(master, plan, dtype=np.float32).tolist()
    [[[0.25, 0.25, 0.25], [0.0, 0.25, 0.5]]]
    """
    source = _checked_master(master)
    frame = aligned_empty((*plan.shape, 3), dtype) if out is None else out
    _check_frame(frame, plan)
    native = chosen()
    if native is None:
        reference.warp_frame(source, plan, frame)
        return frame
    library, level, threads = native
    knots = None if plan.drives is None or frame.dtype == np.float32 else _knots(plan, frame.dtype)
    unit = 1 / 65535 if source.dtype == np.uint16 else 1
    code_bytes = bytes_of_floats(plan.decode)
    job = _Warp(
        *(MASTER_KINDS[source.dtype], KINDS[frame.dtype], *plan.shape, *source.shape[:2]),
        unit,
        *map(pointer, (source, plan.blocks, plan.decode, code_bytes, plan.unmix)),
        *map(pointer, (knots, plan.thresholds, frame)),
    )
    library.procam_warp(level, threads, plan.shape[0], ctypes.byref(job))
    return frame


def _pack(numbers: list[FloatArray], blocks: NDArray[np.void]) -> None:
    """Place, black and share (h, W, n) of a band as its blocks; unknown pixels get no share."""
    height, width = numbers[0].shape[:2]
    held: Array32 = np.zeros((8, BAND, len(blocks) * TILE), np.float32)
    held[PLACE] = np.nan
    for field, plane in enumerate(plane for part in numbers for plane in np.moveaxis(part, -1, 0)):
        held[field, :height, :width] = plane
    unknown = ~np.isfinite(held).all(axis=0)
    held[:, unknown] = 0
    held = held.reshape(8, BAND, -1, BLOCK)
    low, high = held.min(axis=-1), held.max(axis=-1)
    if unknown.any():  # their place is that of another in their block, or strip
        known = np.where(unknown.reshape(held.shape[1:]), np.float32(np.nan), held[PLACE])
        low[PLACE] = _known_nearby(np.fmin.reduce(known, axis=-1))
        high[PLACE] = np.fmax(np.fmax.reduce(known, axis=-1), low[PLACE])
        held[PLACE] = np.where(np.isnan(known), low[PLACE, ..., None], known)
    step = (high - low) / np.float32(65535)
    held -= low[..., None]
    held /= np.where(step > 0, step, 1)[..., None]
    whole = np.rint(np.minimum(held, 65535, out=held), out=held).astype(np.uint16)
    for name, part in (("base", low), ("step", step), ("number", whole)):
        split = part.reshape(8, BAND, *blocks.shape[:2], -1, *part.shape[3:])
        blocks[name] = np.moveaxis(split, (2, 3, 1, 4, 0), (0, 1, 2, 3, 4))


def _known_nearby(least: Array32) -> Array32:
    """Places (2, BAND, blocks), unknown ones by the least of their strip: C decodes what lies between."""
    strips = least.reshape(2, BAND, -1, STRIP // BLOCK)
    nearby = np.nan_to_num(np.fmin.reduce(strips, axis=(1, 3), keepdims=True))
    return np.where(np.isnan(strips), nearby, strips).reshape(least.shape)


def _knots(plan: WarpPlan, kind: np.dtype[Any]) -> NDArray[np.uint32]:
    """Drives (3, 513) as C takes them: integers, with the rise to the next in the high bits."""
    assert plan.drives is not None
    whole = np.ascontiguousarray(np.rint(plan.drives.T * WHOLE[kind]), np.uint32)
    return whole | np.diff(whole, append=whole[:, -1:]) << np.uint32(16)


def _rising(drives: ArrayLike) -> Array:
    """A table of drives that rises from 0 or more to 1 or less."""
    found = _table("drives", drives, (len(KNOTS), 3))
    if (np.diff(found, axis=0) < 0).any() or found.min() < 0 or found.max() > 1:
        raise InputError(
            f"drives: {found.min():.3g} to {found.max():.3g}; the table must rise within 0..1"
        )
    return found


def _thresholds(tile: ArrayLike) -> Array32:
    """A tile of thresholds in [0, 1)."""
    found = _table("thresholds", tile, (TILE, TILE)).astype(np.float32)
    if found.min() < 0 or found.max() >= 1:
        raise InputError(
            f"thresholds: {found.min():.3g} to {found.max():.3g}; they must be 0 or more and below 1"
        )
    return found


def _table(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Finite numbers of one shape."""
    found = np.ascontiguousarray(values, float)
    if found.shape != shape:
        raise ShapeError(name, found.shape, f"{shape}")
    if not np.isfinite(found).all():
        raise InputError(f"{name}: some values are not finite")
    return found


def _checked_master(master: AnyArray) -> AnyArray:
    """A dome master that can be sampled, contiguous and aligned."""
    if master.dtype not in MASTER_KINDS:
        raise InputError(
            f"master: {master.dtype} is not supported; convert it to uint8, uint16, float16 or float32"
        )
    if master.ndim != 3 or master.shape[2] != 3 or min(master.shape[:2]) < LEAST_EDGE:
        raise ShapeError("master", master.shape, "(N, M, 3), N and M 2 or more")
    if master.shape[0] * master.shape[1] > MOST_PIXELS:
        raise ShapeError("master", master.shape, f"at most {MOST_PIXELS} pixels")
    if max(master.shape[:2]) > MOST_EDGE:
        raise ShapeError("master", master.shape, f"edges of at most {MOST_EDGE} pixels")
    return plain(master)


def _check_frame(frame: AnyArray, plan: WarpPlan) -> None:
    """Refuse an array that a frame cannot be written to."""
    if frame.dtype not in KINDS:
        raise InputError(f"frame: {frame.dtype} is not supported; use uint8, uint16 or float32")
    if frame.shape != (*plan.shape, 3):
        raise ShapeError("out", frame.shape, f"{(*plan.shape, 3)}")
    if not (frame.flags.c_contiguous and frame.flags.aligned and frame.flags.writeable):
        raise InputError("out: a writable, contiguous, aligned array is needed")
    if frame.dtype != np.float32 and plan.drives is None:
        raise InputError(
            f"frame: {frame.dtype} needs a plan with drives; this one has none, so use float32"
        )
