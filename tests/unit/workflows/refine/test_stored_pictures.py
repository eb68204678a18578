"""Projector frames and dome masters on disk."""

from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.images.pixels import read_image, write_image
from procam.workflows.refine.stored_pictures import read_frames, read_square, write_frames


def test_frames_are_stored_with_16_bits(tmp_path: Path) -> None:
    frame = np.array([[[0.0, 0.5, 1.0]]], np.float32)
    write_frames({"north": frame}, tmp_path)
    stored = read_image(tmp_path / "north.png")
    assert stored.dtype == np.uint16
    assert stored.ravel().tolist() in ([0, 32767, 65535], [0, 32768, 65535])
    np.testing.assert_allclose(read_frames(tmp_path)["north"], frame, atol=0.5 / 65535)


def test_a_picture_that_is_not_square_is_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "wide.png", np.zeros((2, 4, 3), np.uint16))
    with pytest.raises(FileFormatError, match=r"wide\.png: 4x2 px is no dome master"):
        read_square(tmp_path / "wide.png")
