"""Bare frames on a pipe: rows of RGB without any header, as `ffmpeg -f rawvideo` writes and reads."""

import fcntl
import os
from contextlib import suppress
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError, InputError

Pixels = NDArray[Any]
MOST_PIPE_BYTES = 2**20  # what Linux lets anyone ask for; by default a pipe holds 64 KiB
PIXELS = {"rgb24": "|u1", "rgb48le": "<u2", "rgbf16le": "<f2", "rgbf32le": "<f4"}


def widen(descriptor: int, frame_bytes: int) -> None:
    """Let a pipe hold more, if it is one: a large frame passes in a third of the time.

    Not more than a frame: what waits is late.
    """
    wanted = min(frame_bytes, MOST_PIPE_BYTES)
    with suppress(AttributeError, OSError):  # other systems, other files
        if fcntl.fcntl(descriptor, fcntl.F_GETPIPE_SZ) < wanted:
            fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, wanted)


def require_open(descriptor: int, name: str) -> None:
    """Refuse a pipe that is not there; `name` is the option's."""
    try:
        os.fstat(descriptor)
    except OSError as error:
        raise InputError(
            f"{name}: got - with no file open at {descriptor}, expected a pipe or a file; has it been "
            "closed?"
        ) from error


def pixel_type(name: str) -> np.dtype[Any]:
    """The type of one colour of a layout that FFmpeg calls `name`.

    >>> pixel_type("rgb48le")
    dtype('uint16')
    """
    if name not in PIXELS:
        raise InputError(f"--pixels: got {name!r}, expected one of {', '.join(PIXELS)}")
    return np.dtype(PIXELS[name])


def read_frame(stream: BinaryIO, frame: Pixels, number: int) -> bool:
    """Fill `frame` (H, W, 3) from a pipe; False at the end. A part of a frame is refused."""
    view = frame.reshape(-1).view(np.uint8).data
    filled = 0
    while filled < len(view):
        count = stream.readinto(view[filled:])  # type: ignore[attr-defined]
        if not count:
            break
        filled += count
    if 0 < filled < len(view):
        raise FileFormatError(
            f"stdin: got {filled} bytes of frame {number}, expected {len(view)}; do --size and "
            "--pixels fit what is sent?"
        )
    return filled > 0


def write_frame(stream: BinaryIO, frame: Pixels) -> None:
    """Write a frame (H, W, 3) to a pipe, all of it at once."""
    view = np.ascontiguousarray(frame).reshape(-1).view(np.uint8).data
    while view:
        view = view[stream.write(view) :]
    stream.flush()
