"""Sources and destinations of frames: one picture, numbered pictures, a movie.

A `Clip` reads frames as `ClipFrame`s and stores the compensated ones as the source's kind. The file is
longer than 300 lines because the kinds follow one protocol and read best side by side.
"""

import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from procam.arrays import AnyArray
from procam.errors import FileFormatError, InputError
from procam.files.images.movie_writer import MovieWriter, new_movie, require_written
from procam.files.images.movies import MovieFrame, MovieReader, is_movie
from procam.files.images.pixels import SUFFIXES, require_suffix
from procam.files.images.sequences import Numbered, PictureSequence, find_sequence, parse_pattern
from procam.files.images.stills import read_still, require_finite, write_still
from procam.files.output_log import OutputLog, file_state
from procam.workflows.playout.chunks import Chunks, Part
from procam.workflows.playout.pipeline import ThreadPlan

Row = dict[str, Any]
Reads = Iterator[Callable[[], "ClipFrame | None"]]
ONE_AS_HALF, INFINITE_AS_HALF = 0x3C00, 0x7C00
UNTAGGED = 2  # transfer characteristics as ITU-T H.273 and FFmpeg count them
FILE, MEMORY = "file", "memory"  # what a certificate covers
HIGH_RANGE = {16: " (PQ)", 18: " (HLG)"}


@dataclass(frozen=True, slots=True)
class ClipFrame:
    """One frame of a clip as it came.

    Attributes
    ----------
    number : of the frame. name : of its file, or "frame 12 of FILE"; what messages call it.
    rgb : (N, N, 3) encoded colours in the source's type.
    transfer : name of their transfer function, if the source names one.
    above_one : pixels that ask for more than 1.0. stated : what the source says of its transfer function.
    source_data : what its writer needs of the source.
    note : what became of the source's colour profile. converted : whether its colours were converted.
    wanted : whether it is written; others are read for those that follow them.
    received_s : time of the last byte by time.perf_counter [s].
    """

    number: int
    name: str
    rgb: AnyArray
    transfer: str | None
    above_one: int = 0
    source_data: Any = None
    received_s: float = field(default_factory=time.perf_counter)
    stated: str = ""
    note: str = ""
    converted: bool = False
    wanted: bool = True


@dataclass(frozen=True, slots=True)
class CompensatedFrame:
    """A compensated frame: encoded colours (N, N, 3), their transfer function, the report's row.

    `check` takes the frame as it was read back, and what it was read from, and completes the row.
    """

    rgb: AnyArray
    transfer: str
    row: Row
    check: Callable[[ClipFrame, str], None]


class Clip(ABC):
    """A source of frames and the destination of the compensated ones; a context manager.

    `total` is how many frames will come (0: unknown), `suffix` the kind of the output's pictures, `finished`
    the report's rows of frames that need not come any more. `beyond` is a note, at the end, if frames were
    wanted that it does not have.
    """

    total = 0
    suffix = ""
    finished: Mapping[int, Row] = MappingProxyType({})
    beyond: Sequence[str] = ()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:  # noqa: B027 - most clips have nothing to close
        """Close it."""

    @abstractmethod
    def thread_plan(self, frame_bytes: int) -> ThreadPlan:
        """Threads for it."""

    @abstractmethod
    def reads(self) -> Reads:
        """Jobs that each read a frame; None ends them."""

    @abstractmethod
    def write(self, clip_frame: ClipFrame, result: CompensatedFrame) -> None:
        """Store a compensated frame, read it back and check it."""


class StillClip(Clip):
    """One picture: `read` and `written` are its files, as of all clips that have files."""

    total = 1

    def __init__(self, source: Path, out: Path) -> None:
        require_suffix(out)
        self.source, self.out, self.suffix = source, out, out.suffix
        self.read, self.written = [source], [out]

    def thread_plan(self, frame_bytes: int) -> ThreadPlan:
        """One after the other."""
        return ThreadPlan.for_movie(frame_bytes)

    def reads(self) -> Reads:
        """The picture."""
        yield lambda: read_clip_frame(self.source)

    def write(self, clip_frame: ClipFrame, result: CompensatedFrame) -> None:
        """Write the picture."""
        write_still(self.out, result.rgb, clip_frame.source_data, result.transfer)
        result.check(read_clip_frame(self.out), FILE)


class SequenceClip(Clip):
    """Numbered pictures; those that an earlier run finished from the same source are left out.

    Those of a `part`, or all. Pictures that depend on new ones are made again.
    """

    def __init__(
        self, sequence: PictureSequence, names: Numbered, log: OutputLog, part: Part
    ) -> None:
        self._sequence, self._names, self.log = sequence, names, log
        self.suffix, self._chunks = names.suffix, part.chunks
        numbers = [n for n in sequence.numbers if n in part]
        if not numbers:
            raise InputError(
                f"--frames {part.frames}: IN has frames {sequence.numbers[0]} to {sequence.numbers[-1]}"
            )
        self.beyond = part.beyond(sequence.numbers[0], sequence.numbers[-1])
        sources = {number: sequence.names.path(number) for number in numbers}
        self.read = list(sources.values())
        self.written = [*map(names.path, sources), log.path]
        before = sequence.numbers if part.chunks.lead_in else numbers
        states = {n: file_state(sequence.names.path(n)) for n in before}
        self._states = {n: _state_of(n, states, part.chunks) for n in numbers}
        logged = {n: log.kept(names.path(n), self._states[n]) for n in numbers}
        self.finished = {
            n: row for n, row in logged.items() if row is not None and self.is_whole(n, row)
        }
        self._todo = {number for number in logged if number not in self.finished}
        self.total = len(self._todo)

    def is_whole(self, number: int, row: Row) -> bool:
        """Whether a logged picture, whose own file is whole, needs nothing more."""
        return True

    def thread_plan(self, frame_bytes: int) -> ThreadPlan:
        """Several at once."""
        return ThreadPlan.for_pictures(frame_bytes)

    def reads(self) -> Reads:
        """The pictures that are not finished yet, and those before them in their chunks."""
        numbers = self._sequence.numbers
        for number, wanted in self._chunks.to_read(numbers, self._todo):
            yield partial(self._read, number, wanted)

    def write(self, clip_frame: ClipFrame, result: CompensatedFrame) -> None:
        """Write a picture and log it."""
        state, still = clip_frame.source_data
        out = self._names.path(clip_frame.number)
        write_still(out, result.rgb, still, result.transfer)
        result.check(read_clip_frame(out, clip_frame.number), FILE)
        self.log.add(out, state, result.row)

    def _read(self, number: int, wanted: bool) -> ClipFrame:
        clip_frame = read_clip_frame(self._sequence.names.path(number), number)
        state = self._states.get(number)
        return replace(clip_frame, source_data=(state, clip_frame.source_data), wanted=wanted)


def _state_of(number: int, states: Mapping[int, list[int]], chunks: Chunks) -> list[int]:
    """State of a frame's file, and where others lead it in a checksum of theirs."""
    if not chunks.lead_in:
        return states[number]
    first = chunks.first_needed(number)
    before = [states[n] for n in range(first, number) if n in states]
    return [*states[number], zlib.crc32(repr(before).encode())]


class MovieClip(Clip):
    """A movie, or a part of it, to a movie; it is written anew unless it is complete."""

    def __init__(self, source: Path, out: Path, log: OutputLog, part: Part) -> None:
        require_written(out)
        self._range, self._part = part.frames, part
        frames = part.frames
        if frames and out.exists() and not log.kept(out, file_state(source)):
            raise InputError(
                f"OUT: {out} exists, and each part of a movie needs a file of its own; give another name"
            )
        self._first = part.chunks.first_needed(frames.first) if frames else 0
        self.source, self.out, self.suffix = source, out, out.suffix
        self.read, self.written = [source], [out, log.path]
        self._log = log
        self.stack = ExitStack()
        self._writer: MovieWriter | None = None
        self._checks: list[Callable[[ClipFrame, str], None]] = []  # of the first and last frame

    @property
    def is_made(self) -> bool:
        """Whether an earlier run has finished it."""
        there = self.source.is_file()
        return there and self._log.kept(self.out, file_state(self.source)) is not None

    def __enter__(self) -> Self:
        self.reader = self.stack.enter_context(MovieReader(self.source))
        self._state = file_state(self.source)
        self.total, self._frames, self._count = self.reader.frames, iter(self.reader), 0
        if self._range is not None:
            self.total = max(0, min(self.total, self._range.last + 1) - self._range.first)
        return self

    def __exit__(self, *error: Any) -> None:
        self.stack.__exit__(*error)
        if error == (None, None, None) and self._writer is not None:
            self._check_ends()
            self._log.add(self.out, self._state, {})

    def thread_plan(self, frame_bytes: int) -> ThreadPlan:
        """One frame after the other."""
        return ThreadPlan.for_movie(frame_bytes)

    def reads(self) -> Reads:
        """The frames."""
        return repeat(self._read)

    def write(self, clip_frame: ClipFrame, result: CompensatedFrame) -> None:
        """Encode a frame."""
        if self._writer is None:
            movie = new_movie(self.out, self.reader, transfer=result.transfer)
            self._writer = self.stack.enter_context(movie)
        self._writer.write(result.rgb, clip_frame.source_data)
        self._checks[1:] = [result.check]

    def _check_ends(self) -> None:
        """Read back the first and the last frame: complete rows of the report."""
        with MovieReader(self.out) as written:
            for check, frame in zip(self._checks, written.ends(), strict=False):
                check(movie_clip_frame(written, frame, 0), FILE)

    def _read(self) -> ClipFrame | None:
        for number, frame in enumerate(self._frames, self._count):
            self._count = number + 1
            if self._range is None:
                return movie_clip_frame(self.reader, frame, number)
            if number > self._range.last:
                return None
            if number >= self._first:
                found = movie_clip_frame(self.reader, frame, number)
                return replace(found, wanted=number in self._range)
        self.beyond = self._part.beyond(0, self._count - 1)
        if self._range is not None and self._count <= self._range.first:
            raise InputError(f"--frames {self._range}: IN has frames 0 to {self._count - 1}")
        return None


@dataclass(frozen=True, slots=True)
class Show:
    """Frames that are only read: how many (0: unknown), jobs that each read one, and threads for them."""

    total: int
    reads: Reads
    thread_plan: Callable[[int], ThreadPlan]


@contextmanager
def opened_show(source: Path) -> Iterator[Show]:
    """The frames of a picture, of numbered pictures or of a movie."""
    if is_movie(source):
        with MovieReader(source) as movie:
            frames = (movie_clip_frame(movie, each, n) for n, each in enumerate(movie))
            yield Show(movie.frames, repeat(lambda: next(frames, None)), ThreadPlan.for_movie)
        return
    sequence = source_sequence(source)
    paths = {n: sequence.names.path(n) for n in sequence.numbers} if sequence else {0: source}
    reads = (partial(read_clip_frame, path, number) for number, path in paths.items())
    yield Show(len(paths), reads, ThreadPlan.for_pictures)


def first_frame(source: Path) -> ClipFrame:
    """The first frame of what IN names."""
    with opened_show(source) as show:
        frame = next(show.reads)()
    if frame is None:
        raise FileFormatError(f"{source}: no frame in it; is it the right clip?")
    return frame


def read_clip_frame(path: Path, number: int = 0) -> ClipFrame:
    """A picture with all that is kept of it; refuses light that is NaN or infinite."""
    still = read_still(path)
    above = count_above_one(path, still.rgb)
    stated = still.spec.get_string_attribute("oiio:ColorSpace")
    found = ClipFrame(number, str(path), still.rgb, still.transfer, above, still, stated=stated)
    return replace(found, note=still.note, converted=still.converted)


def movie_clip_frame(reader: MovieReader, frame: MovieFrame, number: int) -> ClipFrame:
    """A frame of a movie."""
    name, tag = f"frame {number} of {reader.path}", int(reader.stream.codec_context.color_trc)
    stated = f"transfer characteristics {tag}{HIGH_RANGE.get(tag, '')}"
    if tag == UNTAGGED:
        stated = "nothing of it"
    found = ClipFrame(number, name, frame.rgb, reader.transfer, source_data=frame, stated=stated)
    return replace(found, note=reader.note)


def keep_note(notes: list[str], note: str) -> None:
    """Keep the note on a clip's first frame, or a longer one that begins alike: a movie's may grow."""
    if note and (not notes or note.startswith(notes[0])):
        notes[:] = [note]


def count_above_one(name: object, rgb: AnyArray) -> int:
    """Pixels above 1.0 in any colour; refuses NaN and infinite values of a frame called `name`."""
    if rgb.dtype.kind != "f":
        return 0
    if rgb.dtype == np.float16:  # as integers, for NumPy is slow with halves
        bits = rgb.view(np.int16)
        finite = (bits & 0x7FFF).max() < INFINITE_AS_HALF
        above = bits > ONE_AS_HALF
    else:
        finite = bool(np.isfinite(rgb.max()) and np.isfinite(rgb.min()))
        above = rgb > 1
    if not finite:
        require_finite(name, np.asarray(rgb, np.float32))
    return int(above.any(axis=-1).sum())


def output_names(sequence: PictureSequence, out: Path) -> Numbered:
    """How the output of a sequence is named: by a pattern, or as the source's in a folder."""
    names = parse_pattern(out)
    if names is None:
        if out.suffix and not out.is_dir():
            raise InputError(
                f"OUT: {out} is one file, but IN has numbered pictures; give a folder, or a pattern "
                "such as out.%04d.exr"
            )
        source = sequence.names
        names = Numbered(out, source.before, source.digits, source.after)
    require_suffix(names.path(0))
    return names


def source_sequence(source: Path) -> PictureSequence | None:
    """The numbered pictures that IN names; None for one picture or a movie."""
    sequence = find_sequence(source)
    if sequence and sequence.names.suffix not in SUFFIXES:
        raise FileFormatError(
            f"{source}: pictures of kind {sequence.names.suffix!r} cannot be read; use .png, .tif or .exr"
        )
    return sequence
