"""Movies whose headers are damaged, where the pictures' own checksums do not notice."""

from pathlib import Path

import av
import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.images import movies
from procam.files.images.matroska import header_is_whole
from procam.files.images.movies import MovieReader

WIDTH = b"\xb0\x81"  # the element of the pictures' width, and its length


def movie(path: Path, codec: str, layout: str) -> Path:
    with av.open(str(path), "w") as made:
        stream = made.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, layout
        for level in range(3):
            rgb = np.full((48, 64, 3), 50 * level, np.uint8)
            frame = av.VideoFrame.from_ndarray(rgb, format="rgb24")
            made.mux(stream.encode(frame.reformat(format=layout)))
        made.mux(stream.encode())
    return path


def test_another_width(tmp_path: Path) -> None:
    path = movie(tmp_path / "a.mkv", "ffv1", "bgr0")
    content = path.read_bytes()
    assert header_is_whole(path)
    assert content.count(WIDTH + b"\x40") == 1
    path.write_bytes(content.replace(WIDTH + b"\x40", WIDTH + b"\x7f"))
    with pytest.raises(FileFormatError, match="a checksum in its header does not match"):
        MovieReader(path)


def test_a_header_without_checksums_is_taken_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w", options={"write_crc32": "0"}) as made:
        stream = made.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "bgr0"
        frame = av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")
        made.mux(stream.encode(frame.reformat(format="bgr0")))
        made.mux(stream.encode())
    assert header_is_whole(path)
    with MovieReader(path) as opened:
        assert len(list(opened)) == 1


def test_a_frame_that_says_it_is_huge(tmp_path: Path) -> None:
    path = movie(tmp_path / "a.mov", "prores_ks", "yuv422p10le")
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
    path = movie(tmp_path / "a.mkv", "ffv1", "bgr0")
    monkeypatch.setattr(movies, "MOST_PIXELS", 1000)
    with pytest.raises(FileFormatError, match="says that pictures are 64x48 px"):
        MovieReader(path)
