"""Numbered pictures: their names, and the numbers that are missing."""

from pathlib import Path

import pytest

from procam.errors import FileFormatError, InputError
from procam.files.images.sequences import Numbered, find_sequence, parse_pattern


def _touch(folder: Path, *names: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name in names:
        (folder / name).write_bytes(b"x")
    return folder


class TestPatterns:
    @pytest.mark.parametrize(
        ("pattern", "name"),
        [
            ("sky.%04d.exr", "sky.0012.exr"),
            ("sky.####.exr", "sky.0012.exr"),
            ("sky_%d.png", "sky_12.png"),
            ("#.tif", "12.tif"),
            ("v2_%06d_left.exr", "v2_000012_left.exr"),
        ],
    )
    def test_names_and_numbers(self, pattern: str, name: str) -> None:
        names = parse_pattern(Path("in") / pattern)
        assert names is not None
        assert names.path(12) == Path("in") / name
        assert names.number_of(name) == 12
        assert names.suffix == Path(pattern).suffix

    def test_a_plain_name_has_no_place_for_a_number(self) -> None:
        assert parse_pattern(Path("sky.0001.exr")) is None
        assert find_sequence(Path("sky.0001.exr")) is None

    @pytest.mark.parametrize("name", ["sky.12.exr", "sky.00012.exr", "sky.x012.exr", "ky.0012.exr"])
    def test_other_paddings_and_names_are_not_of_it(self, name: str) -> None:
        assert Numbered(Path(), "sky.", 4, ".exr").number_of(name) is None

    def test_numbers_may_outgrow_the_padding(self) -> None:
        assert Numbered(Path(), "sky.", 4, ".exr").number_of("sky.12345.exr") == 12345

    def test_two_places_are_refused(self) -> None:
        with pytest.raises(InputError, match="has 2 places for a number; it needs one"):
            parse_pattern(Path("sky.%04d.###.exr"))


class TestFind:
    def test_the_names_of_a_folder_are_recognised(self, tmp_path: Path) -> None:
        _touch(tmp_path, "sky.0099.exr", "sky.0100.exr", "notes.txt", "still.png", ".sky.0098.exr")
        found = find_sequence(tmp_path)
        assert found is not None
        assert found.numbers == (99, 100)
        assert found.names == Numbered(tmp_path, "sky.", 4, ".exr")

    def test_unpadded_numbers_are_sorted_as_numbers(self, tmp_path: Path) -> None:
        _touch(tmp_path, *(f"s{n}.png" for n in range(8, 12)))
        found = find_sequence(tmp_path)
        assert found is not None
        assert found.numbers == (8, 9, 10, 11)

    def test_a_step_is_not_a_gap(self, tmp_path: Path) -> None:
        _touch(tmp_path, *(f"s{n:02d}.png" for n in (10, 15, 20, 30, 25)))
        found = find_sequence(tmp_path / "s##.png")
        assert found is not None
        assert found.numbers == (10, 15, 20, 25, 30)

    @pytest.mark.parametrize(
        ("there", "words"),
        [
            ((1, 2, 5, 6), r": s\.003\.png, s\.004\.png missing between"),
            ((1, 2, 40), r"s\.010\.png and 29 more missing"),
            ((10, 15, 30), r": s\.020\.png, s\.025\.png missing"),  # multiples of its step
        ],
    )
    def test_missing_pictures_are_named(
        self, there: tuple[int, ...], words: str, tmp_path: Path
    ) -> None:
        _touch(tmp_path, *(f"s.{n:03d}.png" for n in there))
        with pytest.raises(FileFormatError, match=words):
            find_sequence(tmp_path)

    def test_a_wide_gap_is_found_quickly(self, tmp_path: Path) -> None:
        last = 10**30 + 1
        _touch(tmp_path, "s.0.png", "s.1.png", f"s.{last}.png")
        with pytest.raises(FileFormatError) as refused:
            find_sequence(tmp_path)
        listed = ", ".join(f"s.{n}.png" for n in range(2, 10))
        assert f"{listed} and {last + 1 - 3 - 8} more missing" in str(refused.value)

    @pytest.mark.parametrize(
        ("odd", "named"),
        [("s.7.png", "s.7.png and s.0001.png"), ("s.00004.png", "s.0001.png and s.00004.png")],
    )
    def test_paddings_are_not_mixed(self, odd: str, named: str, tmp_path: Path) -> None:
        _touch(tmp_path, "s.0001.png", "s.0002.png", "s.0003.png", odd)
        with pytest.raises(FileFormatError, match=f"the numbers of {named} are padded differently"):
            find_sequence(tmp_path)
        found = find_sequence(tmp_path / "s.%04d.png")
        assert found is not None
        assert found.numbers == (1, 2, 3)

    def test_several_sequences_are_refused_by_name(self, tmp_path: Path) -> None:
        _touch(tmp_path, "left.01.exr", "right.01.exr")
        with pytest.raises(
            FileFormatError, match=r"sequences .*: left\.#\.exr, right\.#\.exr\. Name one"
        ):
            find_sequence(tmp_path)

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(FileFormatError, match="these sequences of pictures: none"):
            find_sequence(tmp_path)
        with pytest.raises(FileFormatError, match="no picture has such a name"):
            find_sequence(tmp_path / "s.%d.png")
        with pytest.raises(FileFormatError, match="no such folder"):
            find_sequence(tmp_path / "no" / "s.%d.png")


@pytest.mark.parametrize(
    "name", ["sky.%0999d.exr", "sky.%099999999999d.exr", f"sky.{'#' * 13}.exr"]
)
def test_numbers_of_too_many_digits(name: str) -> None:
    with pytest.raises(InputError, match=r"digits; give 12 or fewer"):
        parse_pattern(Path(name))
