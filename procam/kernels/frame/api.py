"""Compensation of dome masters: sums of their direct light over the dome, and the light to send.

Both read the picture once and take the same steps for each value: decode, subtract scattered light,
clip. The model's fields are read at their own, coarser, resolution and interpolated on the fly, so the
time is near that of moving the picture through memory.
"""

import ctypes

import numpy as np
from numpy.typing import DTypeLike

from procam.arrays import AnyArray, Array, Map
from procam.errors import InputError, ShapeError
from procam.kernels.frame import reference
from procam.kernels.frame.coding import Coding
from procam.kernels.frame.grid import CHANNELS, POSITIONS, STRIP
from procam.kernels.frame.model import TERMS, FrameModel, padded, zeros_to_pad
from procam.kernels.native.arrays import aligned, aligned_empty, numbers, pointer
from procam.kernels.native.loader import LANES, chosen

KINDS = {np.dtype(t): n for n, t in enumerate((np.uint8, np.uint16, np.float32, np.float16))}
MODES = {"light": 0, "content": 1, "excess": 2, "at least": 3, "at most": 4}
APPLY, MIX = 5, 6  # write; write mixed with what came
CHUNK = 64  # as in frame.h


class _Frame(ctypes.Structure):
    """struct procam_frame of native/kernels.h."""

    _fields_ = [
        ("size", ctypes.c_size_t),
        *((name, ctypes.c_int) for name in ("kind", "nodes", "terms", "band")),
        *((name, ctypes.c_float) for name in ("strength", "top", "encode_shift")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("image", "out", "light", "least", "most", "gain", "area"),
                *("weight", "edge_spread", "direction", "lit"),
                *(f"{n}_{p}" for n in POSITIONS for p in ("start", "left", "across")),
                *("down", "along", "rows", "decode", "encode", "threshold", "decode_bytes"),
            )
        ),
    ]


def scattered_light(
    model: FrameModel, coefficients: Array, offset: Array | None = None, out: Map | None = None
) -> Map:
    """Scattered light at each node (M, M, 3) [rel]: spread times the polynomial, plus the lamps' light.

    Parameters
    ----------
    coefficients : (3, 9) of the polynomial, per colour. offset : (3, 9) of a second polynomial, which
        is subtracted, or None.
    out : array (M, M, 3) float32 to write to, such as an earlier result.

    Raises
    ------
    ShapeError, InputError
        Another shape, or an `out` that cannot be written.
    """
    light = zeros_to_pad(model.spread.shape) if out is None else out
    _check_out(light, model.spread.shape, np.float32)
    native = chosen()
    if native is None:
        light[...] = reference.scattered_light(model, coefficients, offset)
        return light
    library, level, threads = native
    arrays = [aligned(a, np.float32) for a in (model.spread, model.direction)]
    ambient = None if model.ambient is None else aligned(model.ambient, np.float32)
    given = [
        None if n is None else numbers(n, (CHANNELS, TERMS), "coefficients")
        for n in (coefficients, offset)
    ]
    library.procam_scattered(
        *(level, threads, model.nodes, model.terms, pointer(arrays[0]), pointer(ambient)),
        *(pointer(arrays[1]), pointer(given[0]), pointer(given[1]), pointer(light)),
    )
    return light


def frame_sums(model: FrameModel, image: AnyArray, light: Map, what: str, coding: Coding) -> Array:
    """Sums over the dome of the light to send, times the monomials of the direction.

    Parameters
    ----------
    image : (N, N, 3) uint8, uint16, float16 or float32.
    light : (M, M, 3), of `scattered_light`.
    what : "light" [rel sr]; "content", without limits; "excess", the light that limits add, times
        `spread`; "at least", "at most": the solid angle where a limit holds [sr].

    Returns
    -------
    sums : (3, terms) float64, of the first 1, 4 or 9 of 1, x, y, z, xy, yz, xz, x^2 - y^2, z^2.
    """
    check_pictures(model.size, image)
    _check_light(model, light)
    if what not in MODES:
        raise InputError(f"what: {what!r} is unknown; choose one of {', '.join(MODES)}")
    picture = aligned(image)
    native = chosen()
    if native is None:
        return reference.frame_sums(model, picture, light, what, coding)
    return _run(native, model, (picture, light, None), MODES[what], coding)


def frame_apply(
    model: FrameModel,
    image: AnyArray,
    light: Map,
    coding: Coding,
    out: AnyArray | None = None,
    sums: Array | None = None,
) -> AnyArray:
    """The light to send (N, N, 3), encoded as the picture is.

    `out` to write to may be the picture itself; `sums` (3, terms) is filled with those of `frame_sums`.
    """
    check_pictures(model.size, image, out)
    _check_light(model, light)
    if sums is not None:
        _check_out(sums, (CHANNELS, model.terms), np.float64, "sums")
    picture = aligned(image)
    target = aligned_empty(picture.shape, picture.dtype) if out is None else out
    native = chosen()
    if native is None:
        found = reference.frame_sums(model, picture, light, "light", coding)
        reference.frame_apply(model, picture, light, coding, target)
    else:
        mode = APPLY if coding.strength >= 1 else MIX
        found = _run(native, model, (picture, light, target), mode, coding)
    if sums is not None:
        sums[...] = found
    return target


def _check_out(out: AnyArray, shape: tuple[int, ...], dtype: DTypeLike, what: str = "out") -> None:
    if out.shape != shape:
        raise ShapeError(what, out.shape, f"{shape}")
    if out.dtype != dtype or not out.flags.carray:
        raise InputError(f"{what}: it must be a writable, contiguous array of {np.dtype(dtype)}")


def _check_light(model: FrameModel, light: Map) -> None:
    if light.shape != model.spread.shape:
        raise ShapeError("light", light.shape, f"{model.spread.shape}")


def check_pictures(size: int, image: AnyArray, out: AnyArray | None = None) -> None:
    """Refuse pictures that the kernels cannot read or write.

    Raises
    ------
    ShapeError, InputError
        Another shape or element type; an `out` that cannot be written, or overlaps the content.
    """
    expected = (size, size, CHANNELS)
    if not isinstance(image, np.ndarray):
        raise InputError(f"content: {type(image).__name__} is no picture; give an array {expected}")
    if image.shape != expected:
        raise ShapeError("content", image.shape, f"{expected}")
    if image.dtype not in KINDS:
        raise InputError(
            f"content: {image.dtype} is not supported; convert it to uint8, uint16, float16 or float32"
        )
    if out is None:
        return
    _check_out(out, expected, image.dtype)
    same = image.ctypes.data == out.ctypes.data and image.strides == out.strides
    if np.may_share_memory(image, out) and not same:
        raise InputError("out: it overlaps the content; pass the content itself or an array apart")


def _run(
    native: tuple[ctypes.CDLL, int, int],
    model: FrameModel,
    pictures: tuple[AnyArray, Map, AnyArray | None],
    mode: int,
    coding: Coding,
) -> Array:
    library, level, threads = native
    setup = _Frame()
    setup.size, setup.kind = model.size, KINDS[pictures[0].dtype]
    setup.nodes, setup.terms, setup.band = model.nodes, model.terms, model.grid.shared
    setup.strength, setup.top = coding.strength, coding.most(pictures[0].dtype)
    image, light, out = pictures
    arrays = model.in_c | {"image": image, "light": padded(light), "out": out}
    if image.dtype == np.uint8:
        arrays |= coding.in_c
        setup.encode_shift = coding.curve.shift
    arrays["lit"] = model.variants(setup.top)
    for name, positions in model.grid.positions(LANES[level]).items():
        arrays |= {f"{name}_{part}": found for part, found in positions.items()}
    for name, array in arrays.items():
        setattr(setup, name, pointer(array))
    strips, chunks = -(-CHANNELS * model.size // STRIP), -(-(model.nodes + 1) // CHUNK)
    sums = np.zeros((strips * chunks, CHANNELS, TERMS))
    library.procam_frame(level, threads, mode, strips, chunks, ctypes.byref(setup), pointer(sums))
    return sums.sum(axis=0)[:, : model.terms]
