"""Compensation of dome masters: sums of light, and the light to send, at the rate of memory."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, ShapeError
from procam.kernels.frame import reference
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.grid import CHANNELS, PLACES, STRIP, Plane
from procam.kernels.frame.model import SPARE, TERMS, FrameModel, spared
from procam.kernels.native.arrays import aligned_like, pointer
from procam.kernels.native.loader import chosen

Double = NDArray[np.float64]
KINDS = {np.dtype(t): n for n, t in enumerate((np.uint8, np.uint16, np.float32, np.float16))}
MODES = {"light": 0, "content": 1, "excess": 2, "at least": 3, "at most": 4}
APPLY = 5
CHUNK = 64  # as in frame.h


class _Frame(ctypes.Structure):
    """struct procam_frame of native/kernels.h."""

    _fields_ = [
        ("size", ctypes.c_size_t),
        *((name, ctypes.c_int) for name in ("kind", "nodes", "terms", "band", "brief")),
        *((name, ctypes.c_float) for name in ("strength", "top")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("image", "out", "light", "least", "most", "gain", "area"),
                *("weight", "paint", "direction", "lit"),
                *(f"{n}_{p}" for n in PLACES for p in ("start", "pair", "across")),
                *("down", "rows", "decode", "encode", "threshold", "decode_bytes"),
            )
        ),
    ]


def _room_of(plane: Plane | None) -> Plane | None:
    """What `plane` begins, with room for vectors to read past its end: as `bounced_light` returns it."""
    room = None if plane is None else plane.base
    if plane is None or room is None:
        return None
    begins = (room.dtype, room.ctypes.data) == (plane.dtype, plane.ctypes.data)
    whole = room.flags.c_contiguous and plane.flags.c_contiguous
    return room if begins and whole and room.size >= plane.size + SPARE else None


def bounced_light(
    model: FrameModel, numbers: Double, offset: Double | None = None, out: Plane | None = None
) -> Plane:
    """What bounces to each node (M, M, 3) [rel]: spread times the polynomial, and the lamps' light.

    Parameters
    ----------
    numbers : (3, 9) its coefficients per colour. offset : (3, 9) of what (W) takes off, or None.
    out : a result of this function for as many nodes, to be written over.
    """
    native = chosen()
    if native is None:
        return reference.bounced_light(model, numbers, offset)
    library, level, threads = native
    size = model.spread.size
    room = _room_of(out)
    if room is None or room.size != size + SPARE:
        room = np.empty(size + SPARE, np.float32)
    arrays = [np.ascontiguousarray(a, np.float32) for a in (model.spread, model.direction)]
    ambient = None if model.ambient is None else np.ascontiguousarray(model.ambient, np.float32)
    given = [None if n is None else np.ascontiguousarray(n, float) for n in (numbers, offset)]
    library.procam_bounce(
        *(level, threads, model.nodes, model.terms, pointer(arrays[0]), pointer(ambient)),
        *(pointer(arrays[1]), pointer(given[0]), pointer(given[1]), pointer(room)),
    )
    return room[:size].reshape(model.spread.shape)


def frame_sums(
    model: FrameModel, image: NDArray[Any], light: Plane, what: str, coding: Coding
) -> Double:
    """Sums over the dome of the light to send, times the monomials of the direction.

    Parameters
    ----------
    image : (N, N, 3) uint8, uint16, float16 or float32.
    light : (M, M, 3), of `bounced_light`.
    what : "light" [rel sr]; "content", without limits; "excess", what limits add, weighed by `spread`;
        "at least", "at most": the solid angle where a limit holds [sr].

    Returns
    -------
    sums : (3, terms) float64, of the first 1, 4 or 9 of 1, x, y, z, xy, yz, xz, x^2 - y^2, z^2.
    """
    check_pictures(model.size, image)
    _check_light(model, light)
    picture = np.ascontiguousarray(image)
    native = chosen()
    if native is None:
        return reference.frame_sums(model, picture, light, what, coding)
    return _run(native, model, (picture, light, None), MODES[what], coding)


def frame_apply(
    model: FrameModel,
    image: NDArray[Any],
    light: Plane,
    coding: Coding,
    out: NDArray[Any] | None = None,
    sums: Double | None = None,
) -> NDArray[Any]:
    """The light to send (N, N, 3), encoded as the picture is.

    `out` to write to may be the picture itself; `sums` (3, terms) is filled with those of `frame_sums`.
    """
    check_pictures(model.size, image, out)
    _check_light(model, light)
    picture = np.ascontiguousarray(image)
    target = aligned_like(picture) if out is None else out
    native = chosen()
    if native is None:
        found = reference.frame_sums(model, picture, light, "light", coding)
        reference.frame_apply(model, picture, light, coding, target)
    else:
        found = _run(native, model, (picture, light, target), APPLY, coding)
    if sums is not None:
        sums[...] = found
    return target


def _check_light(model: FrameModel, light: Plane) -> None:
    if light.shape != model.spread.shape:
        raise ShapeError("light", light.shape, f"{model.spread.shape}")


def check_pictures(size: int, image: NDArray[Any], out: NDArray[Any] | None = None) -> None:
    """Refuse pictures that the kernels cannot read, or not write to.

    Raises
    ------
    ShapeError, InputError
        Another shape or element type; an `out` that cannot be written, or overlaps the content.
    """
    expected = (size, size, CHANNELS)
    if image.shape != expected:
        raise ShapeError("content", image.shape, f"{expected}")
    if image.dtype not in KINDS:
        raise InputError(
            f"content: got {image.dtype}, expected uint8, uint16, float16 or float32; convert it"
        )
    if out is None:
        return
    if out.shape != expected:
        raise ShapeError("out", out.shape, f"{expected}")
    if out.dtype != image.dtype or not out.flags.c_contiguous or not out.flags.writeable:
        raise InputError(
            f"out: got {out.dtype}, expected writable, contiguous {image.dtype}, as the content"
        )
    same = image.ctypes.data == out.ctypes.data and image.strides == out.strides
    if np.may_share_memory(image, out) and not same:
        raise InputError("out: got a part of the content's memory, expected all of it or none")


def _run(
    native: tuple[ctypes.CDLL, int, int],
    model: FrameModel,
    pictures: tuple[NDArray[Any], Plane, NDArray[Any] | None],
    mode: int,
    coding: Coding,
) -> Double:
    library, level, threads = native
    how, tables = _Frame(), coding.tables
    how.size, how.kind = model.size, KINDS[pictures[0].dtype]
    how.nodes, how.terms, how.band = model.nodes, model.terms, model.grid.shared
    how.strength, how.top = coding.strength, coding.most(pictures[0].dtype)
    image, light, out = pictures
    if light.dtype != np.float32 or _room_of(light) is None:
        light = np.asarray(spared(light))
    arrays = model.in_c | tables | {"image": image, "light": light, "out": out}
    arrays["lit"] = model.ways(how.top)
    how.brief = model.brief(pictures[0].dtype, how.top)
    for name, array in arrays.items():
        setattr(how, name, pointer(array))
    strips, chunks = -(-CHANNELS * model.size // STRIP), -(-(model.nodes + 1) // CHUNK)
    sums = np.zeros((strips * chunks, CHANNELS, TERMS))
    library.procam_frame(level, threads, mode, strips, chunks, ctypes.byref(how), pointer(sums))
    return sums.sum(axis=0)[:, : model.terms]
