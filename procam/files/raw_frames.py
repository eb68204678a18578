"""Bare frames on a pipe: rows of RGB without any header, as `ffmpeg -f rawvideo` writes and reads."""

import fcntl
import os
import select
from contextlib import suppress
from typing import Any, BinaryIO, Protocol

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError, InputError

Pixels = NDArray[Any]
MOST_PIPE_BYTES = 2**20  # what Linux lets anyone ask for; by default a pipe holds 64 KiB
WAIT_S = 0.1  # for bytes, before it is looked whether to go on waiting
PIXELS = {"rgb24": "|u1", "rgb48le": "<u2", "rgbf16le": "<f2", "rgbf32le": "<f4"}


class Source(Protocol):
    """Where bytes come from."""

    def readinto(self, view: memoryview, /) -> int:
        """Fill the beginning of `view` with what there is; 0 at the end."""
        ...

    def end(self) -> None:
        """Nothing more is wanted: a thread that waits for bytes gets the end."""
        ...


class PipeSource:
    """Bytes of a file descriptor."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._ended = descriptor, False

    def readinto(self, view: memoryview, /) -> int:
        """Fill the beginning of `view` with what there is; 0 at the end."""
        while not self._ended:
            if select.select([self._descriptor], [], [], WAIT_S)[0]:
                return os.readv(self._descriptor, [view])
        return 0

    def end(self) -> None:
        """Nothing more is wanted: a thread that waits for bytes gets the end."""
        self._ended = True


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


def read_frame(source: Source, frame: Pixels, number: int) -> bool:
    """Fill `frame` (H, W, 3) from a pipe; False at the end. A part of a frame is refused."""
    view = frame.reshape(-1).view(np.uint8).data
    filled = 0
    while filled < len(view):
        count = source.readinto(view[filled:])
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
