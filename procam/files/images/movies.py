"""Movies read frame by frame as RGB, with timestamps and alpha.

PyAV decodes; the frames become RGB in 8 bits, or in 16 where the movie has more. A movie that is damaged,
interlaced or shorter than its header says is refused.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np

from procam.arrays import AnyArray
from procam.errors import FileFormatError
from procam.files.images.ffv1 import has_checksums, is_whole
from procam.files.images.matroska import header_is_whole
from procam.files.images.movie_file import video_library
from procam.files.images.pixel_layouts import (
    BT601,
    BT709,
    FULL,
    LAYOUTS,
    UNKNOWN,
    Converter,
    from_swscale,
)

SUFFIXES = (".mov", ".mp4", ".m4v", ".mkv", ".webm", ".avi", ".mxf")
MOST_PIXELS = 2**27  # of a frame, twice 8192 x 8192; its decoder would ask for gigabytes
HD_LINES = 576  # a movie with more lines that names no matrix is BT.709
TRANSFER = {
    1: "bt1886",
    6: "bt1886",
    14: "bt1886",
    15: "bt1886",
    4: "gamma2.2",
    8: "linear",
    13: "srgb",
}  # FFmpeg's numbers for transfer characteristics, and procam's names


PRIMARIES = {
    5: "BT.601 (625 lines)",
    6: "BT.601 (525 lines)",
    9: "BT.2020",
    11: "DCI-P3",
    12: "Display P3",
}  # FFmpeg's numbers for primaries; 1 is BT.709


@dataclass(frozen=True, slots=True)
class MovieFrame:
    """A frame: `rgb` (H, W, 3) uint8 or uint16, straight `alpha` (H, W) or None, timestamp `pts`."""

    rgb: AnyArray
    alpha: AnyArray | None
    pts: int


class MovieReader:
    """A movie's frames in order; a context manager.

    Attributes
    ----------
    size : (width, height). dtype : uint8, or uint16 where the movie has more than 8 bits.
    transfer : name of the transfer function that the movie is tagged with, or None.
    frames : their number in the file's header; 0 if it has none.
    layout : FFmpeg's name of the pixel layout of the frames that are returned.
    """

    def __init__(self, path: Path) -> None:
        self.path, self._av = path, video_library()
        if not path.is_file():
            raise FileFormatError(f"{path}: no such file; a movie is needed. Check the name")
        try:
            self._movie = self._av.open(str(path), metadata_errors="replace")
        except (self._av.error.FFmpegError, UnicodeDecodeError) as error:
            raise self._damaged(error) from error
        if "matroska" in self._movie.format.name and not header_is_whole(path):
            self._movie.close()
            raise self._damaged("a checksum in its header does not match")
        if not self._movie.streams.video:
            self._movie.close()
            raise FileFormatError(f"{path} holds no pictures; a movie is needed")
        self.stream = self._movie.streams.video[0]
        context = self.stream.codec_context
        if context is None:
            self._movie.close()
            raise self._damaged("its pictures are of an unknown kind")
        self.stream.thread_type = "AUTO"
        context.options = {"max_pixels": str(MOST_PIXELS)}  # also of what each frame says
        self.size = (int(context.width), int(context.height))
        if self.size[0] * self.size[1] > MOST_PIXELS:
            self._movie.close()
            raise self._damaged(
                f"its header says that pictures are {self.size[0]}x{self.size[1]} px"
            )
        self.frames = int(self.stream.frames)
        self.transfer = TRANSFER.get(int(context.color_trc))
        components: Any = context.format.components if context.format else ()
        if len(components) < 3:
            self._movie.close()
            raise FileFormatError(
                f"{path} has pictures of layout {context.pix_fmt}; encode it again in colour"
            )
        deep = max(component.bits for component in components) > 8
        self.dtype = np.dtype(np.uint16 if deep else np.uint8)
        self.has_alpha = any(component.is_alpha for component in components)
        self.layout = LAYOUTS[deep, self.has_alpha]
        self._bits = components[0].bits
        self._convert = Converter(self._av)
        self._uneven, self._from_zero = "", context.name == "ffv1"  # others may begin later

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._movie.close()

    @property
    def note(self) -> str:
        """What the tagged primaries are, unless they are BT.709's, and which frame came out of step."""
        tag = int(self.stream.codec_context.color_primaries)
        if tag in (BT709, UNKNOWN):
            return self._uneven
        primaries = (
            f"{self.path} is tagged with primaries {PRIMARIES.get(tag, tag)}, but its colours were taken as "
            "BT.709's. Convert them, as with ffmpeg's zscale=primaries=709"
        )
        return f"{primaries}. {self._uneven}" if self._uneven else primaries

    @property
    def metadata(self) -> tuple[dict[str, str], dict[str, str]]:
        """Metadata of the movie and of its video stream."""
        return dict(self._movie.metadata), dict(self.stream.metadata)

    def __iter__(self) -> Iterator[MovieFrame]:
        """Frames in the order in which they are shown."""
        count, end_s, shown_s = 0, Fraction(0), Fraction(0)
        step_s, tick_s = (
            1 / Fraction(self.stream.average_rate or 1),
            Fraction(self.stream.time_base),
        )
        try:
            for frame in self._decoded():
                ready = self._frame(frame, count)
                now_s = frame.pts * tick_s
                late_s = now_s - shown_s - step_s if count else now_s * self._from_zero
                if abs(late_s) > step_s / 2 and not self._uneven:
                    self._uneven = self._out_of_step(count, float(now_s))
                yield ready
                count, shown_s = count + 1, now_s
                end_s = now_s + (frame.duration or 0) * tick_s
        except (self._av.error.FFmpegError, UnicodeDecodeError) as error:
            raise self._damaged(error) from error
        promised_s = self._duration_s()
        if end_s < promised_s - (step_s / 2 if end_s > shown_s else 2 * step_s):
            raise FileFormatError(
                f"{self.path} is truncated: its pictures end at {float(end_s):.3f} s, its header says "
                f"{promised_s:.3f} s. Copy it again"
            )

    def _out_of_step(self, count: int, time_s: float) -> str:
        rate = float(self.stream.average_rate or 1)
        where = f"frame {count} of {self.path}" if count else f"{self.path}: its first frame"
        return (
            f"{where} is shown at {time_s:.3f} s, out of step with {rate:.5g} frames per second: are frames "
            "missing, or is the file damaged?"
        )

    def _decoded(self) -> Iterator[Any]:
        """PyAV's frames; refuses those of FFV1 whose checksums do not hold."""
        context = self.stream.codec_context
        # version 3; older ones have no checksums
        sliced = context.name == "ffv1" and bool(context.extradata)
        checked: bool | None = None
        for packet in self._movie.demux(self.stream):
            if sliced and packet.size and checked is not False:
                content = bytes(packet)
                checked = has_checksums(content) if checked is None else checked
                if checked is not False and not is_whole(content):
                    at_s = float((packet.pts or 0) * packet.time_base)
                    raise self._damaged(f"the checksum of the frame at {at_s:.3f} s does not match")
            yield from packet.decode()

    def ends(self) -> tuple[MovieFrame, MovieFrame]:
        """The first and the last frame; of those in between only what the last one needs is decoded."""
        frames = iter(self)
        first = last = next(frames)
        self._movie.seek((self._movie.start_time or 0) + (self._movie.duration or 0))
        for frame in self:
            last = frame
        return first, last

    def _duration_s(self) -> float:
        """End of the last picture in the file's header [s]; 0 if it has none."""
        if self.stream.duration is not None:
            ticks = (self.stream.start_time or 0) + self.stream.duration
            return float(ticks * self.stream.time_base)
        tag = re.fullmatch(r"(\d+):(\d+):([\d.]+)", self.stream.metadata.get("DURATION", ""))
        return 3600 * int(tag[1]) + 60 * int(tag[2]) + float(tag[3]) if tag else 0.0

    def _frame(self, frame: Any, count: int) -> MovieFrame:
        if frame.is_corrupt or frame.interlaced_frame or frame.pts is None:
            what = "damaged" if frame.is_corrupt else "interlaced"
            what = "without a timestamp" if frame.pts is None else what
            raise FileFormatError(
                f"{self.path}: frame {count} is {what}; complete progressive pictures are needed. "
                "Encode or copy it again"
            )
        limited = not frame.format.is_rgb and int(frame.color_range) != FULL
        limited &= not frame.format.name.startswith("yuvj")
        matrix = int(frame.colorspace) if not frame.format.is_rgb else BT709
        if matrix == UNKNOWN:
            matrix = BT709 if frame.height > HD_LINES else BT601
        plain = self._convert.frame(frame, self.layout, matrix, (limited, False))
        pixels: AnyArray = plain.to_ndarray()
        rgb = np.ascontiguousarray(pixels[..., :3])
        alpha = np.ascontiguousarray(pixels[..., 3]) if self.has_alpha else None
        if self.dtype == np.uint16 and not frame.format.is_rgb:
            rgb = from_swscale(rgb, 8 if limited else self._bits)
            alpha = None if alpha is None else from_swscale(alpha, self._bits)
        return MovieFrame(rgb, alpha, int(frame.pts))

    def _damaged(self, error: object) -> FileFormatError:
        reason = " ".join(str(error).split())
        return FileFormatError(
            f"{self.path} is not a complete movie ({reason}); copy it again, or encode it as one of "
            f"{', '.join(SUFFIXES)}"
        )


def is_movie(path: Path) -> bool:
    """Whether a name has the suffix of a movie."""
    return path.suffix.lower() in SUFFIXES
