"""Movies written frame by frame with the properties of another: timestamps, alpha, tags and sound.

The writer takes the frame rate, time base, colour tags and metadata of the source, converts each frame to
the codec's layout, and copies the sound in step with the pictures.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np

from procam.arrays import AnyArray
from procam.errors import InputError
from procam.files.images.movie_file import MovieFile, new_movie_file, video_library
from procam.files.images.movies import MovieFrame, MovieReader
from procam.files.images.pixel_layouts import (
    BT709,
    FULL,
    LIMITED,
    RGB_MATRIX,
    UNKNOWN,
    Converter,
    to_swscale,
)
from procam.files.images.slideshow import CODEC, OPTIONS

WRITTEN = (".mov", ".mkv")
PRORES = {
    "rgb24": "yuv444p10le",
    "rgb48le": "yuv444p10le",
    "rgba": "yuva444p10le",
    "rgba64le": "yuva444p10le",
}
FFV1 = {"rgb24": "bgr0", "rgb48le": "gbrp16le", "rgba": "bgra", "rgba64le": "gbrap16le"}
LOSSLESS = {"level": "3", "slicecrc": "1", "g": "1"}
NOT_KEPT = ("encoder", "handler_name", "vendor_id", "DURATION")
TAG = {"bt1886": 1, "gamma2.4": 1, "gamma2.2": 4, "linear": 8, "srgb": 13}


@contextmanager
def new_movie(
    path: Path,
    like: MovieReader,
    *,
    transfer: str,
    size: tuple[int, int] | None = None,
    layout: str = "",
) -> Iterator["MovieWriter"]:
    """A writer of a movie with the properties of another; the file appears when the block has ended.

    .mov is ProRes 4444 (10 bits, visually lossless), .mkv is FFV1 in RGB (lossless). Frame rate,
    timestamps, pixel aspect, primaries, tags and sound are the source's; so are `size` (width, height)
    and `layout` (one of `LAYOUTS`) of its frames unless they are given. `transfer` is the name of their
    transfer function.
    """
    require_written(path)
    av = video_library()
    name = "mov" if path.suffix == ".mov" else "matroska"
    with new_movie_file(path, name) as movie, av.open(str(like.path)) as source:
        writer = MovieWriter(movie, like, layout or like.layout)
        writer.add_streams(source, transfer, size or like.size)
        yield writer
        writer.finish()


class MovieWriter:
    """Encodes frames; `new_movie` makes it."""

    def __init__(self, movie: MovieFile, like: MovieReader, layout: str) -> None:
        self._movie, self._like, self._layout = movie, like, layout
        self._av = video_library()
        self._convert = Converter(self._av)
        self._prores = movie.container.format.name == "mov"
        self._pixels = (PRORES if self._prores else FFV1)[layout]

    def add_streams(self, source: Any, transfer: str, size: tuple[int, int]) -> None:
        """Add the streams; `source` is the source opened once more, for its sound."""
        self._stream = self._new_stream(transfer, size)
        self._sound = _Sound(source, self._movie)

    def write(self, rgb: AnyArray, frame: MovieFrame) -> None:
        """Encode colours (H, W, 3) with the alpha and the timestamp of a frame of the source."""
        pixels = to_swscale(rgb) if self._prores and rgb.dtype == np.uint16 else rgb
        if frame.alpha is not None:
            pixels = np.concatenate([pixels, frame.alpha[..., None]], axis=-1)
        whole = np.ascontiguousarray(pixels)
        encoded = self._av.VideoFrame.from_ndarray(whole, format=self._layout)
        encoded = self._convert.frame(encoded, self._pixels, BT709, (False, self._prores))
        context = self._stream.codec_context
        for tag in ("color_primaries", "color_trc", "color_range", "colorspace"):
            setattr(encoded, tag, getattr(context, tag))  # ProRes takes the tags of the frame
        encoded.pts, encoded.time_base = self._clock.ticks(frame.pts), self._clock.out
        self._mux(self._stream.encode(encoded))

    def finish(self) -> None:
        """Encode the frames that the encoder still holds, and the rest of the sound."""
        self._mux(self._stream.encode())
        self._sound.mux_rest()

    def _new_stream(self, transfer: str, size: tuple[int, int]) -> Any:
        source = self._like.stream
        self._clock = _Clock.of(source)
        codec, options = (CODEC, OPTIONS) if self._prores else ("ffv1", LOSSLESS)
        stream = self._movie.container.add_stream(codec, rate=self._clock.rate, options=options)
        stream.width, stream.height = size
        stream.pix_fmt = self._pixels
        context, original = stream.codec_context, source.codec_context
        context.time_base = stream.time_base = self._clock.out
        context.color_primaries = original.color_primaries
        context.color_trc = TAG.get(transfer, UNKNOWN)
        context.color_range = LIMITED if self._prores else FULL
        context.colorspace = BT709 if self._prores else RGB_MATRIX
        if original.sample_aspect_ratio:
            context.sample_aspect_ratio = original.sample_aspect_ratio
        of_movie, of_stream = self._like.metadata
        self._movie.container.metadata.update(of_movie)
        stream.metadata.update({k: v for k, v in of_stream.items() if k not in NOT_KEPT})
        return stream

    def _mux(self, packets: list[Any]) -> None:
        for packet in packets:
            if packet.dts is not None:
                self._sound.mux_until(packet.dts * packet.time_base)
            self._movie.mux(packet)


@dataclass(frozen=True, slots=True)
class _Clock:
    """Timestamps of a movie in a unit [s] that also holds its frame rate exactly.

    Matroska rounds times to milliseconds. A frame within half a millisecond of its time at a constant
    rate gets that time.
    """

    rate: Fraction
    source: Fraction
    out: Fraction

    @classmethod
    def of(cls, stream: Any) -> Self:
        rate = Fraction(stream.average_rate or stream.guessed_rate)
        source = Fraction(stream.time_base)
        exact = (1 / (rate * source)).denominator == 1
        return cls(rate, source, source if exact else source / rate.numerator)

    def ticks(self, pts: int) -> int:
        time = pts * self.source
        steady = round(time * self.rate) / self.rate
        return int((steady if abs(time - steady) <= self.source / 2 else time) / self.out)


class _Sound:
    """Copies the sound of a movie into another, in step with the pictures."""

    def __init__(self, source: Any, movie: MovieFile) -> None:
        self._movie = movie
        streams = source.streams.audio
        self._copies = {s.index: movie.container.add_stream_from_template(s) for s in streams}
        self._packets = source.demux(*streams) if streams else iter(())
        self._next: Any = next(self._packets, None)

    def mux_until(self, time_s: Fraction) -> None:
        """Copy the sound up to a time."""
        while self._next is not None and (
            self._next.dts is None or self._next.dts * self._next.time_base <= time_s
        ):
            self._copy()

    def mux_rest(self) -> None:
        """Copy the remaining sound."""
        while self._next is not None:
            self._copy()

    def _copy(self) -> None:
        packet = self._next
        if packet.dts is not None:
            packet.stream = self._copies[packet.stream.index]
            self._movie.mux(packet)
        self._next = next(self._packets, None)


def require_written(path: Path) -> None:
    """Refuse a name whose format `new_movie` does not write."""
    if path.suffix not in WRITTEN:
        raise InputError(
            f"{path}: movies are written as .mov (ProRes 4444) or .mkv (FFV1, lossless), not "
            f"{path.suffix!r}; encode one of those for playback afterwards"
        )
