"""Bare frames from stdin to stdout."""

import os
import sys
from pathlib import Path
from typing import Any

from procam.errors import InputError
from procam.files.calibration import load_dome
from procam.generators import result_of
from procam.memory import keep_large_buffers
from procam.workflows.playout.chunks import ENDLESS
from procam.workflows.playout.compensate import compensate_clip
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.pipe_clip import PipeClip, pixel_type, require_open

PIPE = Path("-")
SIZES_PX = (2, 16384)  # edges of frames on a pipe


def check_pipe(source: Path, out: Path, size: int, pixels: str) -> None:
    """Refuse an IN, OUT, --edge and --pixels that describe no frames on a pipe."""
    if (source, out) != (PIPE, PIPE):
        raise InputError(f"IN is {source} and OUT is {out}; either both are - or neither is")
    if size == 0 or not pixels:
        raise InputError(
            "IN is -, and frames on a pipe have no header: give --edge and --pixels, such as "
            "--edge 4096 --pixels rgb24"
        )
    if not SIZES_PX[0] <= size <= SIZES_PX[1]:
        raise InputError(
            f"--edge is {size} px; it must be that of a frame, from {SIZES_PX[0]} to {SIZES_PX[1]} px, as "
            "the sender gives it"
        )


def compensate_pipe(
    calibration: Path, size: int, pixels: str, settings: FrameSettings, *, certify: bool
) -> dict[int, dict[str, Any]]:
    """Compensate frames of `size` px as they come; returns the lines of the report if `certify`.

    Prints the latency on stderr at the end.
    """
    from procam.files.system import widen_pipe

    keep_large_buffers()
    dtype = pixel_type(pixels)
    for descriptor, name in enumerate(("IN", "OUT")):
        require_open(descriptor, name)
        widen_pipe(descriptor, size**2 * 3 * dtype.itemsize)
    with (  # no buffers in between: a frame is sent when it is made
        os.fdopen(0, "rb", buffering=0, closefd=False) as stdin,
        os.fdopen(1, "wb", buffering=0, closefd=False) as stdout,
    ):
        clip = PipeClip((stdin, stdout), size, dtype)
        loaded = load_dome(calibration)  # while the first frame is read
        try:
            made = result_of(compensate_clip(loaded, clip, settings, certify, ENDLESS))
        except BrokenPipeError as error:
            raise InputError(
                f"OUT: the reader of stdout stopped after {len(clip.latency_s)} frames; it must read "
                "to the end"
            ) from error
    sys.stderr.write(_latency(clip) + "\n")
    return made.rows


def _latency(clip: PipeClip) -> str:
    """How long frames took, from the last byte that was read to the last that was sent."""
    import numpy as np

    ms = 1000 * np.array(clip.latency_s)
    middle, late = np.quantile(ms, (0.5, 0.95))
    return (
        f"{len(ms)} frames; latency median {middle:.1f} ms, 95 % within {late:.1f} ms, "
        f"longest {ms.max():.1f} ms, first {ms[0]:.1f} ms"
    )
