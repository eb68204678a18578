"""Numbered pictures: how they are named, what is missing, and what a log says is made."""

from pathlib import Path

import pytest

from procam.errors import FileFormatError, InputError
from procam.files.images.sequences import (
    MadeLog,
    Numbered,
    find_sequence,
    parse_pattern,
    state_of,
)


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
        with pytest.raises(InputError, match=r"got 2 places for a number, expected one"):
            parse_pattern(Path("sky.%04d.###.exr"))


class TestFind:
    def test_a_folder_tells_its_names(self, tmp_path: Path) -> None:
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

    def test_a_step_is_no_gap(self, tmp_path: Path) -> None:
        _touch(tmp_path, *(f"s{n:02d}.png" for n in (10, 15, 20, 30, 25)))
        found = find_sequence(tmp_path / "s##.png")
        assert found is not None
        assert found.numbers == (10, 15, 20, 25, 30)

    def test_missing_pictures_are_named(self, tmp_path: Path) -> None:
        _touch(tmp_path, *(f"s.{n:03d}.png" for n in (1, 2, 5, 6)))
        with pytest.raises(
            FileFormatError, match=r"gap in the numbering, s\.003\.png, s\.004\.png missing"
        ):
            find_sequence(tmp_path)

    def test_many_missing_pictures_are_counted(self, tmp_path: Path) -> None:
        _touch(tmp_path, *(f"s.{n:03d}.png" for n in (1, 2, 40)))
        with pytest.raises(FileFormatError, match=r"s\.010\.png and 29 more missing"):
            find_sequence(tmp_path)

    def test_a_gap_however_wide_costs_no_time(self, tmp_path: Path) -> None:
        last = 10**30 + 1
        _touch(tmp_path, "s.0.png", "s.1.png", f"s.{last}.png")
        with pytest.raises(FileFormatError) as refused:
            find_sequence(tmp_path)
        listed = ", ".join(f"s.{n}.png" for n in range(2, 10))
        assert f"{listed} and {last + 1 - 3 - 8} more missing" in str(refused.value)

    def test_the_missing_of_a_stepped_sequence_are_multiples_of_its_step(
        self, tmp_path: Path
    ) -> None:
        _touch(tmp_path, *(f"s{n:02d}.png" for n in (10, 15, 30)))
        with pytest.raises(FileFormatError, match=r"numbering, s20\.png, s25\.png missing"):
            find_sequence(tmp_path)

    @pytest.mark.parametrize(
        ("odd", "named"),
        [("s.7.png", "s.7.png and s.0001.png"), ("s.00004.png", "s.0001.png and s.00004.png")],
    )
    def test_paddings_are_not_mixed(self, odd: str, named: str, tmp_path: Path) -> None:
        _touch(tmp_path, "s.0001.png", "s.0002.png", "s.0003.png", odd)
        with pytest.raises(FileFormatError, match=f"got {named}, expected one padding"):
            find_sequence(tmp_path)
        found = find_sequence(tmp_path / "s.%04d.png")
        assert found is not None
        assert found.numbers == (1, 2, 3)

    def test_several_sequences_are_refused_by_name(self, tmp_path: Path) -> None:
        _touch(tmp_path, "left.01.exr", "right.01.exr")
        with pytest.raises(FileFormatError, match=r"got left\.#\.exr, right\.#\.exr, expected"):
            find_sequence(tmp_path)

    def test_nothing_there(self, tmp_path: Path) -> None:
        with pytest.raises(FileFormatError, match="got none, expected the numbered pictures"):
            find_sequence(tmp_path)
        with pytest.raises(FileFormatError, match="got no picture of that name"):
            find_sequence(tmp_path / "s.%d.png")
        with pytest.raises(FileFormatError, match="got no such folder"):
            find_sequence(tmp_path / "no" / "s.%d.png")


class TestMadeLog:
    def made(self, tmp_path: Path, key: str = "k") -> tuple[MadeLog, Path, list[int]]:
        _touch(tmp_path, "in.png", "out.png")
        return (
            MadeLog(tmp_path / "log.jsonl", key),
            tmp_path / "out.png",
            state_of(tmp_path / "in.png"),
        )

    def test_what_was_made_of_the_same_is_found_again(self, tmp_path: Path) -> None:
        log, out, state = self.made(tmp_path)
        log.add(out, state, {"s": 0.5})
        assert MadeLog(log.path, "k").made(out, state) == {"s": 0.5}

    def test_other_settings_sources_or_outputs_are_not_the_same(self, tmp_path: Path) -> None:
        log, out, state = self.made(tmp_path)
        log.add(out, state, {})
        again = MadeLog(log.path, "k")
        assert MadeLog(log.path, "other").made(out, state) is None
        assert again.made(out, [state[0], state[1] + 1]) is None
        assert again.made(tmp_path / "in.png", state) is None
        out.write_bytes(b"torn or other")
        assert again.made(out, state) is None
        out.unlink()
        assert again.made(out, state) is None

    def test_a_torn_line_costs_its_own_file_only(self, tmp_path: Path) -> None:
        log, out, state = self.made(tmp_path)
        log.add(out, state, {"n": 1})
        with log.path.open("ab") as file:
            file.write(b'{"out": "out.p')
        log = MadeLog(log.path, "k")
        assert log.made(out, state) == {"n": 1}
        (tmp_path / "next.png").write_bytes(b"y")
        log.add(tmp_path / "next.png", state, {"n": 2})
        again = MadeLog(log.path, "k")
        assert again.made(out, state) == {"n": 1}
        assert again.made(tmp_path / "next.png", state) == {"n": 2}

    def test_lines_that_are_no_records_tell_nothing(self, tmp_path: Path) -> None:
        log, out, state = self.made(tmp_path)
        log.path.write_text("[1, 2]\nhello\n")
        assert MadeLog(log.path, "k").made(out, state) is None
