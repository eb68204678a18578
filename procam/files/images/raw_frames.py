"""Bare frames on a pipe: rows of RGB without any header, as `ffmpeg -f rawvideo` writes and reads."""

import os
from typing import Any, BinaryIO

import numpy as np

from procam.arrays import AnyArray
from procam.errors import FileFormatError, InputError

PIXELS = {"rgb24": "|u1", "rgb48le": "<u2", "rgbf16le": "<f2", "rgbf32le": "<f4"}


def require_open(descriptor: int, name: str) -> None:
    """Refuse a pipe that is not open; `name` is that of the argument."""
    try:
        os.fstat(descriptor)
    except OSError as error:
        raise InputError(
            f"{name}: - was given, but no pipe or file is open at {descriptor}; has it been closed?"
        ) from error


def pixel_type(name: str) -> np.dtype[Any]:
    """The type of one colour of a layout that FFmpeg calls `name`.

    >>> pixel_type("rgb48le")
    dtype('uint16')
    """
    if name not in PIXELS:
        raise InputError(f"--pixels is {name!r}; it must be one of {', '.join(PIXELS)}")
    return np.dtype(PIXELS[name])


def read_frame(stream: BinaryIO, frame: AnyArray, number: int) -> bool:
    """Fill `frame` (H, W, 3) from a pipe; False at the end. An incomplete frame is refused."""
    view = frame.reshape(-1).view(np.uint8).data
    filled = 0
    while filled < len(view):
        count = stream.readinto(view[filled:])  # type: ignore[attr-defined]
        if not count:
            break
        filled += count
    if 0 < filled < len(view):
        raise FileFormatError(
            f"stdin ended after {filled} of the {len(view)} bytes of frame {number}; check that --size "
            "and --pixels describe the frames that are sent"
        )
    return filled > 0


def write_frame(stream: BinaryIO, frame: AnyArray) -> None:
    """Write a frame (H, W, 3) to a pipe, all of it at once."""
    view = np.ascontiguousarray(frame).reshape(-1).view(np.uint8).data
    while view:
        view = view[stream.write(view) :]
    stream.flush()
