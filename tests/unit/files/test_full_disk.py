"""Writers on a full disk: the good file stays, the error says what happened, the next run is whole.

The disk is full after a share of the bytes that a file needs, by the limit that a system sets on the
size of a process's files.
"""

import errno
import io
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import OpenImageIO as oiio
import pytest
from lossless_movies import write_lossless
from small_files import files_up_to

from procam.errors import FileFormatError
from procam.files import atomic
from procam.files.images.layers import write_channels, write_layers
from procam.files.images.movie_file import MovieFile, _ErrorKeepingFile
from procam.files.images.movie_writer import new_movie
from procam.files.images.movies import MovieReader
from procam.files.images.pixels import write_image
from procam.files.images.slideshow import write_movie

ROOM = (0, 0.001, 0.3, 0.8, 0.95, 0.99, 0.999, 1.0)
NOISE = np.random.default_rng(0).random((64, 96, 3))
CODES = (NOISE * 65535).astype(np.uint16)
LIGHT = NOISE.astype(np.float32)
SOURCE = "source.mkv"
STILLS = [((CODES >> 8).astype(np.uint8), 1), ((CODES >> 9).astype(np.uint8), 1)]


@pytest.fixture(scope="module", autouse=True)
def source(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The movie that `compensated` copies."""
    picture = (CODES >> 8).astype(np.uint8)
    shifted = (np.roll(picture, shift, axis=1) for shift in range(8))
    write_lossless(tmp_path_factory.getbasetemp() / SOURCE, shifted)


def compensated(path: Path) -> None:
    """A movie with the frames of another."""
    with (
        MovieReader(path.parents[1] / SOURCE) as reader,
        new_movie(path, reader, transfer="srgb") as writer,
    ):
        for frame in reader:
            writer.write(frame.rgb, frame)


WRITERS: dict[str, Callable[[Path], None]] = {
    "8 bits.png": lambda path: write_image(path, (CODES >> 8).astype(np.uint8)),
    "16 bits.png": lambda path: write_image(path, CODES),
    "capture.tif": lambda path: write_image(path, CODES[..., 0]),
    "light.exr": lambda path: write_image(path, LIGHT),
    "half.exr": lambda path: write_image(path, NOISE.astype(np.float16)),
    "channels.exr": lambda path: write_channels(path, {"b": LIGHT[..., 0], "a": LIGHT[..., 1]}),
    "layers.exr": lambda path: write_layers(path, {"hi": LIGHT, "coverage": LIGHT[..., 0]}),
    "movie.mov": lambda path: write_movie(path, STILLS),
    "light.mov": compensated,
    "light.mkv": compensated,
    "text.json": lambda path: atomic.write_text(path, "0.123 " * 40000),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_whole_or_the_old_one_stays(name: str, tmp_path: Path) -> None:
    path, write = tmp_path / name, WRITERS[name]
    write(path)
    whole = path.read_bytes()
    for share in ROOM:
        path.write_bytes(b"the good file")
        with files_up_to(int(share * len(whole)) - (share == 1)):
            with pytest.raises(OSError, match=rf"File too large: .*{name.partition('.')[0]}"):
                write(path)
        assert path.read_bytes() == b"the good file", share
        assert [file.name for file in tmp_path.iterdir()] == [name], share
    write(path)
    assert len(path.read_bytes()) == len(whole)


def test_a_write_that_failed_is_an_error_though_later_ones_found_space(tmp_path: Path) -> None:
    """FFmpeg would go on, and the movie would play up to the hole."""

    class Full:
        seek = staticmethod(lambda _: None)

        def write(self, data: bytes) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

    file = _ErrorKeepingFile(Full())  # type: ignore[arg-type]
    assert file.write(b"abc") == 3 == file.tell()
    assert file.seek(-1, io.SEEK_END) == 2
    with pytest.raises(OSError, match="No space left"):
        MovieFile(SimpleNamespace(mux=lambda _: None), file).mux(
            SimpleNamespace(stream=SimpleNamespace(type="video"))
        )


def test_pixels_that_were_not_stored_are_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that had room again when the file was closed: only reading it back shows the hole."""
    create, path = oiio.ImageOutput.create, tmp_path / "light.exr"
    write_image(path, LIGHT)
    before = path.read_bytes()

    class Losing:
        def __init__(self, name: str) -> None:
            self.file = create(name)

        def __getattr__(self, name: str) -> object:
            return getattr(self.file, name)

        def write_image(self, pixels: np.ndarray) -> bool:
            whole = pixels.copy()
            whole[40:] = 0
            return bool(self.file.write_image(whole))

    monkeypatch.setattr(oiio.ImageOutput, "create", Losing)
    with pytest.raises(
        FileFormatError, match=r"light.exr could not be written: .*read back\. Is the disk"
    ):
        write_image(path, LIGHT * 2)
    assert path.read_bytes() == before
