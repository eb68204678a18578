"""Checks of what options name."""

from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError, InputError
from procam.files.images.layers import write_channels
from procam.files.images.pixels import write_image
from procam.interfaces.cli._paths import check_out, one_size, photographs, read_grey, two_counts


class TestCheckOut:
    def test_a_new_file_in_a_new_folder(self, tmp_path: Path) -> None:
        check_out(tmp_path / "new" / "a.toml", ".toml", option="OUT")

    @pytest.mark.parametrize(
        ("name", "words"),
        [
            ("a.csv", "must end in .toml"),
            ("folder.toml", "this is a folder"),
            ("notes/a.toml", "notes is a file, not a folder"),
        ],
    )
    def test_refusals(self, name: str, words: str, tmp_path: Path) -> None:
        (tmp_path / "folder.toml").mkdir()
        (tmp_path / "notes").touch()
        with pytest.raises(InputError, match=words):
            check_out(tmp_path / name, ".toml", option="OUT")


def test_two_counts() -> None:
    assert two_counts("--size", "1280x800", "WIDTHxHEIGHT") == (1280, 800)
    for text in ("1280", "0x7", "-1x7", "axb", "", "12X7"):
        with pytest.raises(InputError, match="is not of the form WIDTHxHEIGHT"):
            two_counts("--size", text, "WIDTHxHEIGHT")


def test_photographs_of_files_and_folders(tmp_path: Path) -> None:
    for name in ("b.png", "a.png", "notes.txt"):
        (tmp_path / name).touch()
    single = tmp_path / "notes.txt"
    assert photographs(single) == [single]
    assert [p.name for p in photographs(tmp_path)] == ["a.png", "b.png"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="no photographs here"):
        photographs(tmp_path / "empty")


class TestReadGrey:
    def test_integers_stay_integers(self, tmp_path: Path) -> None:
        pixels = np.zeros((4, 5, 3), np.uint8)
        pixels[..., 1] = 5  # the mean, 1.67, is rounded
        write_image(tmp_path / "a.png", pixels)
        grey = read_grey(tmp_path / "a.png")
        assert grey.dtype == np.uint8 and (grey == 2).all()

    def test_nan_is_refused(self, tmp_path: Path) -> None:
        values = np.ones((4, 5), np.float32)
        values[1, 2] = np.nan
        write_channels(tmp_path / "a.exr", dict.fromkeys("RGB", values))
        with pytest.raises(FileFormatError, match="1 pixels are NaN"):
            read_grey(tmp_path / "a.exr")


def test_one_size() -> None:
    sizes = {Path(f"{k}.png"): (6, 4) for k in range(6)}
    assert one_size(sizes) == (6, 4)
    expected = r"6x4 \(0.png, 1.png, 2.png, 3.png and 2 more\) and 4x6 \(turned.png\)"
    with pytest.raises(InputError, match=expected):
        one_size({**sizes, Path("turned.png"): (4, 6)})
