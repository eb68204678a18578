"""Movies of still pictures: every picture is shown for its time."""

import sys
from pathlib import Path

import numpy as np
import pytest

from procam.errors import InputError
from procam.estimate.structured_light.codes import generate, make_code
from procam.files.images.slideshow import RATE, write_movie


def test_pictures_come_back(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="needs the extra `video`")
    stills = generate(make_code("gray", (160, 96)))[:6]
    colour = np.zeros((96, 160, 3), np.uint8)
    colour[..., 0] = 255
    held = [(picture, 1 + i % 2) for i, picture in enumerate([*stills, colour])]
    write_movie(tmp_path / "m.mov", held)
    expected = [picture for picture, seconds in held for _ in range(seconds * RATE)]
    with av.open(str(tmp_path / "m.mov")) as movie:
        stream = movie.streams.video[0]
        assert stream.average_rate == RATE
        shown = [frame.to_ndarray(format="rgb24") for frame in movie.decode(stream)]
    assert len(shown) == len(expected)
    for found, wanted in zip(shown, expected, strict=True):
        assert np.abs(found.astype(int) - wanted).max() <= 2


def test_without_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(InputError, match=r"needs PyAV, .* pip install 'procam\[video\]'"):
        write_movie(tmp_path / "m.mov", [])
    assert list(tmp_path.iterdir()) == []
