"""The file that a movie is encoded into.

FFmpeg crashes, or ends a file early without a word, when the disk is full. It therefore writes into an
object that always takes what it is given and keeps the system's first error for procam to raise.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from procam.errors import FileFormatError, InputError
from procam.files.atomic import replacing, require_room


def video_library() -> ModuleType:
    """PyAV; the error names the extra if it is not installed."""
    try:
        import av  # noqa: PLC0415 - an extra: only movies need it
    except ImportError as error:
        raise InputError(
            "--movie needs PyAV, which is not installed; run: python -m pip install 'procam[video]', "
            "or show the pictures one by one"
        ) from error
    return av


class MovieFile:
    """A movie that is being written; `new_movie_file` makes it.

    Attributes
    ----------
    container : PyAV's, for streams and metadata. pictures : packets of the video stream so far.
    """

    def __init__(self, container: Any, file: "_ErrorKeepingFile") -> None:
        self.container, self._file, self.pictures = container, file, 0

    def mux(self, packet: Any) -> None:
        """Write a packet.

        Raises
        ------
        OSError
            If it, or one before it, found no room on the disk.
        """
        self.pictures += packet.stream.type == "video"
        self.container.mux(packet)
        self._file.check()


@contextmanager
def new_movie_file(path: Path, container: str) -> Iterator[MovieFile]:
    """A movie that replaces `path` when the block has ended and all its pictures are in the file."""
    av = video_library()
    with replacing(path) as temporary:
        with temporary.open("wb", buffering=0) as raw:
            file = _ErrorKeepingFile(raw)
            with av.open(file, "w", format=container) as movie:
                written = MovieFile(movie, file)
                yield written
            file.check()
        require_room(temporary)
        with av.open(str(temporary)) as movie:
            found = sum(bool(packet.size) for packet in movie.demux(video=0))
        if found != written.pictures:
            raise FileFormatError(
                f"{path} could not be written: {found} of {written.pictures} pictures are in the file. Is "
                "the disk failing? Write to another one"
            )


class _ErrorKeepingFile:
    """A new file as FFmpeg needs it; the first error is kept for `check`, and nothing is written after it."""

    def __init__(self, raw: io.FileIO) -> None:
        self._raw, self._position, self._end = raw, 0, 0
        self._error: OSError | None = None

    def write(self, data: bytes) -> int:
        """Take all bytes."""
        rest = memoryview(data)
        try:
            while rest and self._error is None:
                rest = rest[self._raw.write(rest) :]
        except OSError as error:
            self._error = error
        self._position += len(data)
        self._end = max(self._end, self._position)
        return len(data)

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move as in any file."""
        start = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._end}[whence]
        self._position = start + offset
        self._raw.seek(self._position)
        return self._position

    def tell(self) -> int:
        """Position [byte]."""
        return self._position

    def check(self) -> None:
        """Raise the first error of the system, if there was one."""
        if self._error is not None:
            raise self._error
