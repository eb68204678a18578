"""Movies read and written frame by frame as RGB, with timestamps, alpha, tags and sound kept.

PyAV decodes and encodes; swscale converts between the codec's pixel layout and RGB. swscale is accurate
to half a step in 8 bits, but its 16-bit white is 255/256 of full scale for limited range, and slightly
below full scale for full range; `_from_swscale` and `_to_swscale` correct this. The writer takes the
rate, time base, colour tags and sound of the source movie, and interleaves the sound with the pictures.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from procam.errors import FileFormatError, InputError
from procam.files.atomic import replacing
from procam.files.images.slideshow import CODEC, OPTIONS, video_library

Pixels = NDArray[Any]
SUFFIXES = (".mov", ".mp4", ".m4v", ".mkv", ".webm", ".avi", ".mxf")
WRITTEN = (".mov", ".mkv")
LAYOUTS = {
    (False, False): "rgb24",
    (True, False): "rgb48le",
    (False, True): "rgba",
    (True, True): "rgba64le",
}  # by whether more than 8 bits, and whether there is alpha
PRORES = {
    "rgb24": "yuv444p10le",
    "rgb48le": "yuv444p10le",
    "rgba": "yuva444p10le",
    "rgba64le": "yuva444p10le",
}
FFV1 = {"rgb24": "bgr0", "rgb48le": "gbrp16le", "rgba": "bgra", "rgba64le": "gbrap16le"}
LOSSLESS = {"level": "3", "slicecrc": "1", "g": "1"}
NOT_KEPT = ("encoder", "handler_name", "vendor_id", "DURATION")
# exact to half a step of 8 bits; the defaults are off by up to 3
SCALING = "BICUBIC", "ACCURATE_RND", "FULL_CHR_H_INT", "FULL_CHR_H_INP"
LIMITED, FULL = 1, 2  # FFmpeg's colour ranges
RGB_MATRIX, BT709, BT601, UNKNOWN = 0, 1, 5, 2  # FFmpeg's colour matrices
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
TAG = {"bt1886": 1, "gamma2.4": 1, "gamma2.2": 4, "linear": 8, "srgb": 13}


@dataclass(frozen=True, slots=True)
class MovieFrame:
    """A frame: `rgb` (H, W, 3) uint8 or uint16, straight `alpha` (H, W) or None, timestamp `pts`."""

    rgb: Pixels
    alpha: Pixels | None
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
            self._movie = self._av.open(str(path))
        except self._av.error.FFmpegError as error:
            raise self._damaged(error) from error
        if not self._movie.streams.video:
            self._movie.close()
            raise FileFormatError(f"{path} holds no pictures; a movie is needed")
        self.stream = self._movie.streams.video[0]
        self.stream.thread_type = "AUTO"
        context = self.stream.codec_context
        self.size = (int(context.width), int(context.height))
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
        self._convert = _Converter(self._av)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._movie.close()

    @property
    def metadata(self) -> tuple[dict[str, str], dict[str, str]]:
        """Metadata of the movie and of its video stream."""
        return dict(self._movie.metadata), dict(self.stream.metadata)

    def __iter__(self) -> Iterator[MovieFrame]:
        """Frames in the order in which they are shown."""
        count, end_s = 0, Fraction(0)
        try:
            for frame in self._movie.decode(self.stream):
                yield self._frame(frame, count)
                count += 1
                end_s = (frame.pts + (frame.duration or 0)) * Fraction(self.stream.time_base)
        except self._av.error.FFmpegError as error:
            raise self._damaged(error) from error
        promised_s = self._duration_s()
        if end_s < promised_s - 2 / Fraction(self.stream.average_rate or 1):
            raise FileFormatError(
                f"{self.path} is truncated: its pictures end at {float(end_s):.3f} s, its header says "
                f"{promised_s:.3f} s. Copy it again"
            )

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
        limited = _is_yuv(frame.format) and int(frame.color_range) != FULL
        limited &= not frame.format.name.startswith("yuvj")
        matrix = int(frame.colorspace) if _is_yuv(frame.format) else BT709
        if matrix == UNKNOWN:
            matrix = BT709 if frame.height > HD_LINES else BT601
        plain = self._convert.frame(frame, self.layout, matrix, (limited, False))
        pixels: Pixels = plain.to_ndarray()
        rgb = np.ascontiguousarray(pixels[..., :3])
        alpha = np.ascontiguousarray(pixels[..., 3]) if self.has_alpha else None
        if self.dtype == np.uint16 and _is_yuv(frame.format):
            rgb = _from_swscale(rgb, 8 if limited else self._bits)
            alpha = None if alpha is None else _from_swscale(alpha, self._bits)
        return MovieFrame(rgb, alpha, int(frame.pts))

    def _damaged(self, error: Exception) -> FileFormatError:
        reason = " ".join(str(error).split())
        return FileFormatError(
            f"{self.path} is not a complete movie ({reason}); copy it again, or encode it as one of "
            f"{', '.join(SUFFIXES)}"
        )


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
    with (
        replacing(path) as temporary,
        av.open(str(temporary), "w", format=name) as movie,
        av.open(str(like.path)) as source,
    ):
        writer = MovieWriter(movie, like, layout or like.layout)
        writer.add_streams(source, transfer, size or like.size)
        yield writer
        writer.finish()


class MovieWriter:
    """Encodes frames; `new_movie` makes it."""

    def __init__(self, movie: Any, like: MovieReader, layout: str) -> None:
        self._movie, self._like, self._layout = movie, like, layout
        self._av = video_library()
        self._convert = _Converter(self._av)
        self._prores = movie.format.name == "mov"
        self._pixels = (PRORES if self._prores else FFV1)[layout]

    def add_streams(self, source: Any, transfer: str, size: tuple[int, int]) -> None:
        """Add the streams; `source` is the source opened once more, for its sound."""
        self._stream = self._new_stream(transfer, size)
        self._sound = _Sound(source, self._movie)

    def write(self, rgb: Pixels, frame: MovieFrame) -> None:
        """Encode colours (H, W, 3) with the alpha and the timestamp of a frame of the source."""
        pixels = _to_swscale(rgb) if self._prores and rgb.dtype == np.uint16 else rgb
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
        stream = self._movie.add_stream(codec, rate=self._clock.rate, options=options)
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
        self._movie.metadata.update(of_movie)
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

    def __init__(self, source: Any, movie: Any) -> None:
        self._movie = movie
        streams = source.streams.audio
        self._copies = {s.index: movie.add_stream_from_template(s) for s in streams}
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


class _Converter:
    """Changes the pixel layout of frames with swscale's exact paths."""

    def __init__(self, av: Any) -> None:
        kinds = av.video.reformatter.Interpolation
        self._flags = kinds(0)
        for name in SCALING:
            self._flags |= kinds[name]
        self._reformatter = av.video.reformatter.VideoReformatter()

    def frame(self, frame: Any, layout: str, matrix: int, limited: tuple[bool, bool]) -> Any:
        """The frame in another layout; `limited`: whether source and result have limited range."""
        return self._reformatter.reformat(
            frame,
            format=layout,
            src_colorspace=matrix,
            dst_colorspace=matrix,
            interpolation=self._flags,
            src_color_range=LIMITED if limited[0] else FULL,
            dst_color_range=LIMITED if limited[1] else FULL,
        )


def is_movie(path: Path) -> bool:
    """Whether a name has the suffix of a movie."""
    return path.suffix.lower() in SUFFIXES


def require_written(path: Path) -> None:
    """Refuse a name whose format `new_movie` does not write."""
    if path.suffix not in WRITTEN:
        raise InputError(
            f"{path}: movies are written as .mov (ProRes 4444) or .mkv (FFV1, lossless), not "
            f"{path.suffix!r}; encode one of those for playback afterwards"
        )


def _is_yuv(layout: Any) -> bool:
    return not layout.is_rgb


def _from_swscale(pixels: Pixels, bits: int) -> Pixels:
    """16-bit RGB whose white is (2^bits - 1) << (16 - bits), with white at 65535."""
    top = np.uint16(((1 << bits) - 1) << (16 - bits))
    clipped = np.minimum(pixels, top)
    return np.asarray(clipped + (clipped >> np.uint16(bits)))


def _to_swscale(pixels: Pixels) -> Pixels:
    """16-bit RGB with white at 65280, which swscale takes for white in limited range."""
    whole = np.asarray(pixels, np.uint16)
    return np.asarray(whole - (whole >> np.uint16(8)))
