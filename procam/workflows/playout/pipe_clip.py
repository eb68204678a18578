"""Bare frames on pipes: rows of RGB without any header, as `ffmpeg -f rawvideo` writes and reads."""

import os
import time
from array import array
from dataclasses import replace
from itertools import chain, repeat
from typing import Any, BinaryIO

import numpy as np

from procam.arrays import AnyArray
from procam.errors import FileFormatError, InputError
from procam.threads import start
from procam.workflows.playout.pipeline import ThreadPlan
from procam.workflows.playout.sources import (
    MEMORY,
    Clip,
    ClipFrame,
    CompensatedFrame,
    Reads,
    count_above_one,
)

PIXELS = {"rgb24": "|u1", "rgb48le": "<u2", "rgbf16le": "<f2", "rgbf32le": "<f4"}


class PipeClip(Clip):
    """Bare frames from a pipe to a pipe; it keeps how long each took from whole to sent.

    The first is read from the start on, so that a calibration can be read meanwhile.
    """

    def __init__(self, pipes: tuple[BinaryIO, BinaryIO], size: int, dtype: np.dtype[Any]) -> None:
        self._source, self._out = pipes
        self._size, self._dtype = size, dtype
        self._count = 0
        self.latency_s = array("f")
        self._first = start(self._read)

    def thread_plan(self, frame_bytes: int) -> ThreadPlan:
        """As little waiting as can be."""
        return ThreadPlan.for_pipe()

    def reads(self) -> Reads:
        """Frames until the pipe ends."""
        return chain([self._first.result], repeat(self._read))

    def write(self, clip_frame: ClipFrame, result: CompensatedFrame) -> None:
        """Send a frame at once; it cannot be read back."""
        write_frame(self._out, result.rgb)
        self.latency_s.append(time.perf_counter() - clip_frame.received_s)
        result.check(replace(clip_frame, rgb=result.rgb, transfer=result.transfer), MEMORY)

    def _read(self) -> ClipFrame | None:
        rgb: AnyArray = np.empty((self._size, self._size, 3), self._dtype)
        if not read_frame(self._source, rgb, self._count):
            return None
        self._count += 1
        number = self._count - 1
        name = f"frame {number} of stdin"
        default = "linear" if self._dtype.kind == "f" else "srgb"
        return ClipFrame(number, name, rgb, default, count_above_one(name, rgb))


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
