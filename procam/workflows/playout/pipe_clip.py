"""Bare frames from a pipe to a pipe."""

import time
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, repeat
from types import MappingProxyType
from typing import Any, BinaryIO, Self

import numpy as np

from procam.arrays import AnyArray
from procam.files.images.raw_frames import read_frame, write_frame
from procam.threads import start
from procam.workflows.playout.pipeline import ThreadPlan
from procam.workflows.playout.sources import (
    MEMORY,
    ClipFrame,
    CompensatedFrame,
    Reads,
    Row,
    count_above_one,
)


class PipeClip:
    """Bare frames from a pipe to a pipe; it keeps how long each took from whole to sent.

    The first is read from the start on, so that a calibration can be read meanwhile.
    """

    total = 0
    suffix = ""
    finished: Mapping[int, Row] = MappingProxyType({})
    beyond: Sequence[str] = ()

    def __init__(self, pipes: tuple[BinaryIO, BinaryIO], size: int, dtype: np.dtype[Any]) -> None:
        self._source, self._out = pipes
        self._size, self._dtype = size, dtype
        self._count = 0
        self.latency_s = array("f")
        self._first = start(self._read)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """The pipes are the system's."""

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
