"""Movies whose headers are damaged, where the pictures' own checksums do not notice."""

from pathlib import Path

import numpy as np
import pytest
from lossless_movies import write_lossless

from procam.errors import FileFormatError
from procam.files.images import movies
from procam.files.images.matroska import header_is_whole
from procam.files.images.movie_writer import new_movie
from procam.files.images.movies import MovieReader

GREYS = [np.full((48, 64, 3), level, np.uint8) for level in (0, 50, 100)]
WIDTH = b"\xb0\x81"  # the element of the pictures' width, and its length


def test_another_width(tmp_path: Path) -> None:
    path = write_lossless(tmp_path / "a.mkv", GREYS)
    content = path.read_bytes()
    assert header_is_whole(path)
    assert content.count(WIDTH + b"\x40") == 1
    path.write_bytes(content.replace(WIDTH + b"\x40", WIDTH + b"\x7f"))
    with pytest.raises(FileFormatError, match="a checksum in its header does not match"):
        MovieReader(path)


def test_a_header_without_checksums_is_taken_as_it_is(tmp_path: Path) -> None:
    path = write_lossless(tmp_path / "a.mkv", GREYS, write_crc32="0")
    assert header_is_whole(path)
    with MovieReader(path) as opened:
        assert len(list(opened)) == len(GREYS)


def test_a_frame_that_says_it_is_huge(tmp_path: Path) -> None:
    path = tmp_path / "a.mov"
    source = write_lossless(tmp_path / "a.mkv", GREYS)
    with MovieReader(source) as reader, new_movie(path, reader, transfer="srgb") as made:
        for each in reader:
            made.write(each.rgb, each)
    content = bytearray(path.read_bytes())
    at = content.find(b"icpf") + 12
    assert content[at : at + 4] == (64).to_bytes(2, "big") + (48).to_bytes(2, "big")
    content[at : at + 4] = b"\x7f\xff\x7f\xff"
    path.write_bytes(content)
    with (
        MovieReader(path) as opened,
        pytest.raises(FileFormatError, match="is not a complete movie"),
    ):
        list(opened)


def test_a_header_that_says_it_is_huge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_lossless(tmp_path / "a.mkv", GREYS)
    monkeypatch.setattr(movies, "MOST_PIXELS", 1000)
    with pytest.raises(FileFormatError, match="says that pictures are 64x48 px"):
        MovieReader(path)
