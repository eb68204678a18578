"""Chunks of a clip: each starts from itself, so that any split of the frames gives the same bytes.

A frame is solved from the solution of the one before. At the start of each chunk, by the frames' numbers,
that is forgotten, in a run over the whole clip too. Where pictures follow each other in time, the next chunk
is led in: its compensator also gets the last frames before it, so that nothing jumps.
"""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from procam.arrays import AnyArray
from procam.compensate.any_screen import AnyCompensator
from procam.compensate.solved_frame import SolvedFrame
from procam.errors import InputError


@dataclass(frozen=True, slots=True)
class FrameRange:
    """Frames from `first` to `last`, both included, by their numbers; a movie's are counted from 0."""

    first: int
    last: int

    @classmethod
    def parsed(cls, text: str) -> "FrameRange":
        """Of the text "12-40" or "12".

        Raises
        ------
        InputError
            It is no range.
        """
        found = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", text.strip())
        if found is None or int(found[2] or found[1]) < int(found[1]):
            raise InputError(
                f"--frames {text}: is no range; give the first and last number, as 12-40"
            )
        return cls(int(found[1]), int(found[2] or found[1]))

    def __contains__(self, number: int) -> bool:
        return self.first <= number <= self.last

    def __str__(self) -> str:
        return f"{self.first}-{self.last}"


@dataclass(frozen=True, slots=True)
class Chunks:
    """Chunks of `length` frames, each led in by the `lead_in` frames before it."""

    length: int
    lead_in: int = 0

    def of(self, number: int) -> tuple[int, int]:
        """The chunk of a frame, and the chunk that it leads in; the same if it leads none in."""
        return number // self.length, (number + self.lead_in) // self.length

    def first_needed(self, number: int) -> int:
        """The first frame that the solution of a frame depends on."""
        return number // self.length * self.length - self.lead_in

    def to_read(
        self, numbers: Sequence[int], wanted: Collection[int]
    ) -> Iterator[tuple[int, bool]]:
        """Numbers of frames to read, in order, and whether each is wanted or only precedes one that is."""
        last = {number // self.length: number for number in sorted(wanted)}
        for number in numbers:
            if any(number <= last.get(chunk, -1) for chunk in self.of(number)):
                yield number, number in wanted


# to start anew every 32 frames costs an exact solution no time that can be measured; a movie's step from 32
# frames of lead-in to the next chunk is as large as its other steps, and without them ten times as large
EXACT, VIDEO = Chunks(32), Chunks(128, 32)
ENDLESS = Chunks(2**62)  # of a pipe, which is never split


@dataclass(frozen=True, slots=True)
class Part:
    """The frames of a clip that are wanted, or all, and the chunks in which they are solved."""

    frames: FrameRange | None = None
    chunks: Chunks = EXACT

    def __contains__(self, number: int) -> bool:
        return self.frames is None or number in self.frames

    def beyond(self, first: int, last: int) -> list[str]:
        """A note if frames are wanted that a clip of frames `first` to `last` does not have."""
        if self.frames is None or first <= self.frames.first <= self.frames.last <= last:
            return []
        return [f"--frames {self.frames}: IN has frames {first} to {last} only"]


class ChunkedCompensator:
    """Solves frames in their order, each chunk from itself; `make` gives a new compensator."""

    def __init__(self, make: Callable[[], AnyCompensator], chunks: Chunks) -> None:
        self._make, self._chunks = make, chunks
        self._by_chunk = dict[int, AnyCompensator]()

    @cached_property
    def first(self) -> AnyCompensator:
        """The compensator of the first chunk."""
        return self._make()

    def solve(self, number: int, image: AnyArray, out: AnyArray | None = None) -> SolvedFrame:
        """Solve a frame, see `Compensator.solve`."""
        chunk, following = self._chunks.of(number)
        if following != chunk:
            self._of(following).solve(image)
        return self._of(chunk).solve(image, out)

    def _of(self, chunk: int) -> AnyCompensator:
        if chunk not in self._by_chunk:
            over = [each for each in self._by_chunk if each < chunk - (self._chunks.lead_in > 0)]
            if over:
                compensator = self._by_chunk.pop(over[0])
            else:
                compensator = self._make() if self._by_chunk else self.first
            compensator.restart()
            self._by_chunk[chunk] = compensator
        return self._by_chunk[chunk]
