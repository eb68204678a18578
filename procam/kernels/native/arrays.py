"""Arrays for C: checked, contiguous, aligned."""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from procam.arrays import AnyArray, Array, Array32
from procam.errors import InputError, ShapeError

KINDS = {np.dtype(np.uint8): 0, np.dtype(np.uint16): 1, np.dtype(np.float32): 2}
LINE = 64  # bytes of a cache line; aligned results can bypass the cache


def kind_of(array: AnyArray, what: str) -> int:
    """Number of the element type of a picture in C (enum kind)."""
    if array.dtype not in KINDS:
        raise InputError(
            f"{what}: {array.dtype} is not supported; convert it to uint8, uint16 or float32"
        )
    return KINDS[array.dtype]


def check_numbers(found: AnyArray, shape: tuple[int | None, ...], what: str) -> None:
    """Refuse arrays of another shape, in which None is any length, or not of real numbers.

    Raises
    ------
    ShapeError, InputError
        Another shape; complex numbers, texts or objects.
    """
    alike = found.shape == shape or (
        found.ndim == len(shape)
        and all(n in {None, m} for n, m in zip(shape, found.shape, strict=True))
    )
    if not alike:
        needed = ", ".join("any" if n is None else str(n) for n in shape)
        raise ShapeError(what, found.shape, f"({needed})")
    if found.dtype.kind not in "iuf":
        raise InputError(f"{what}: {found.dtype} is no type of real numbers; convert it to float64")


def numbers(values: ArrayLike, shape: tuple[int | None, ...], what: str) -> Array:
    """Real numbers as a contiguous float64 array of a shape: see `check_numbers`."""
    found = np.asarray(values)
    check_numbers(found, shape, what)
    return plain(np.asarray(found, np.float64))


def check_frames(frames: Sequence[AnyArray], least: int, most: int) -> list[AnyArray]:
    """Pictures of one shape and element type, between `least` and `most` of them."""
    if not least <= len(frames) <= most:
        raise InputError(f"frames: {len(frames)} were given; {least} to {most} are needed")
    found = [np.asarray(frame) for frame in frames]
    kind_of(found[0], "frame 0")
    for k, frame in enumerate(found):
        if frame.shape != found[0].shape:
            raise ShapeError(f"frame {k}", frame.shape, f"{found[0].shape}")
        if frame.dtype != found[0].dtype:
            raise InputError(f"frame {k}: it is {frame.dtype}; {found[0].dtype} is needed")
    return found


def plain(array: AnyArray) -> AnyArray:
    """The array itself if it is contiguous and aligned, else a copy."""
    fits = array.flags.c_contiguous and array.flags.aligned
    return array if fits else np.require(array, requirements=["C", "A"])


def aligned(values: ArrayLike, dtype: DTypeLike | None = None) -> AnyArray:
    """Values of a type as a contiguous array at an address that C can read; `np.ascontiguousarray` is not."""
    return plain(np.asarray(values, dtype))


def pointer(array: AnyArray | None) -> int | None:
    """Address of the first element, for C to read on from there."""
    assert array is None or (array.flags.c_contiguous and array.flags.aligned)
    return None if array is None else array.ctypes.data


def pointers(arrays: Sequence[AnyArray | None]) -> Any:
    """Addresses of several arrays as a C array."""
    return (ctypes.c_void_p * len(arrays))(*(pointer(array) for array in arrays))


def bytes_of_floats(table: Array32) -> AnyArray:
    """A table (256,) split into four of its bytes (4, 256), for AVX-512."""
    split = aligned_empty((table.itemsize, len(table)), np.uint8)
    split[...] = table.view(np.uint8).reshape(-1, table.itemsize).T
    return split


def aligned_empty(shape: tuple[int, ...], dtype: DTypeLike) -> AnyArray:
    """An empty array that begins on a cache line, so that writes can pass the cache."""
    size = int(np.prod(shape, dtype=int)) * np.dtype(dtype).itemsize
    room = np.empty(size + LINE, np.uint8)
    start = -room.ctypes.data % LINE
    return room[start : start + size].view(dtype).reshape(shape)


def least_colour(field: AnyArray) -> AnyArray:
    """The minimum over three colours (..., 3), logical and for booleans. Ten times as fast as `min`."""
    return np.minimum(np.minimum(field[..., 0], field[..., 1]), field[..., 2])
