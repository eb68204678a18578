"""Readings of a hand meter: what is read, and one line for every mistake."""

from pathlib import Path

import numpy as np
import pytest

from procam.errors import FileFormatError
from procam.files.meter import read_meter

PROJECTORS = ("south", "north")
HEADER = "projector,patch,azimuth_deg,elevation_deg,Y,x,y"
TRISTIMULUS = "projector,patch,azimuth_deg,elevation_deg,X,Y,Z"
EXPECTED = "projector,patch,azimuth_deg,elevation_deg,Y,x,y (or X,Y,Z)"


def write(folder: Path, *lines: str) -> Path:
    path = folder / "readings.csv"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def refused(path: Path) -> str:
    with pytest.raises(FileFormatError) as caught:
        read_meter(path, PROJECTORS)
    text = str(caught.value)
    assert text.startswith(str(path)) and "\n" not in text
    return text.removeprefix(str(path))


class TestReading:
    def test_chromaticities(self, tmp_path: Path) -> None:
        path = write(
            tmp_path,
            "# CS-150, serial 7",
            HEADER,
            "",
            "south,Red,-10.5,42, 2.0,0.68,0.32  # dawn",
            "north,BLACK,170,30,0,0,0",
        )
        red, black = read_meter(path, PROJECTORS)
        assert (red.projector, red.patch, red.azimuth_deg, red.elevation_deg) == (
            "south",
            "red",
            -10.5,
            42.0,
        )
        assert red.xyz == pytest.approx([2 * 0.68 / 0.32, 2.0, 0.0])
        assert (black.patch, black.xyz.tolist()) == ("black", [0, 0, 0])
        assert str(red) == "red of south at azimuth -10.5, elevation 42 deg"

    def test_published_white(self, tmp_path: Path) -> None:
        """D65: x 0.31271, y 0.32902 is X 0.95043, Z 1.08890 (CIE 15)."""
        path = write(tmp_path, HEADER, "south,white,0,40,1,0.31271,0.32902")
        assert read_meter(path, PROJECTORS)[0].xyz == pytest.approx([0.95045, 1, 1.08890], abs=3e-5)

    def test_columns_in_another_order_and_more_of_them(self, tmp_path: Path) -> None:
        path = write(
            tmp_path,
            "time,Z,Y,X,patch,projector,elevation_deg,azimuth_deg",
            '"12:00, noon",3,2,1,green,north,50,-20',
        )
        (found,) = read_meter(path, PROJECTORS)
        assert found.spot == ("north", -20.0, 50.0)
        assert found.xyz.tolist() == [1, 2, 3]

    def test_a_byte_order_mark(self, tmp_path: Path) -> None:
        path = tmp_path / "excel.csv"
        path.write_text(f"{HEADER}\nsouth,red,0,40,1,0.6,0.3\n", "utf-8-sig")
        assert len(read_meter(path, PROJECTORS)) == 1

    def test_means_are_of_light(self, tmp_path: Path) -> None:
        """Y and XYZ add, x and y do not."""
        path = write(
            tmp_path,
            HEADER,
            "south,white,0,40,1.0,0.5,0.25",
            "south,red,0,40,2.0,0.6,0.3",
            "south,white,0.0,40.0,4.0,0.2,0.5",
            "south,white,5,40,9.0,0.2,0.5",
        )
        white, red, elsewhere = read_meter(path, PROJECTORS)
        assert [white.count, red.count, elsewhere.count] == [2, 1, 1]
        assert white.xyz == pytest.approx([(2.0 + 1.6) / 2, 2.5, (1.0 + 2.4) / 2])

    def test_where_it_points(self, tmp_path: Path) -> None:
        (left,) = read_meter(write(tmp_path, HEADER, "south,white,90,0,1,.3,.3"), PROJECTORS)
        assert left.direction == pytest.approx(np.array([0, 1, 0]), abs=1e-12)


class TestMistakes:
    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("west,red,0,40,1,.6,.3", "projector 'west' is not one of south, north"),
            (
                "south,pink,0,40,1,.6,.3",
                "patch 'pink' is not one of red, green, blue, white, black",
            ),
            ("south,red,0,40,1,.6", "the line has 6 cells, and the first line 7; write decimal "),
            (
                "south,red,0,40,1,6,.6,3",
                "the line has 8 cells, and the first line 7; write decim",
            ),
            ("south,red,0,forty,1,.6,.3", "elevation_deg is 'forty'; it must be a number"),
            ("south,red,0,40,nan,.6,.3", "Y is 'nan'; it must be a number"),
            ("south,red,0,40,,.6,.3", "Y is ''; it must be a number"),
            ("south,red,0,91,1,.6,.3", "elevation_deg is 91; it must be -90 to 90 degrees"),
            ("south,red,-361,9,1,.6,.3", "azimuth_deg is -361; it must be -360 to 360 degrees"),
            (
                "south,red,0,40,-1,.6,.3",
                "Y is -1; write 0 for a value below the meter's range",
            ),
            ("south,red,0,40,1e300,.6,.3", "Y is 1e+300 cd/m2, more than the sun's; is the unit"),
            (
                "south,red,0,40,1,.6,1e-300",
                "x is 0.6 and y 1e-300, but y must be above 0 and x + y at most 1",
            ),
            ("south,red,0,40,0,.6,.3", "Y is 0 for red; was the shutter closed?"),
            ("south,red,0,40,1,1.2,.3", "x is 1.2; it must be 0 to 1"),
            ("south,red,0,40,1,.6,-.3", "y is -0.3; it must be 0 to 1"),
            (
                "south,red,0,40,1,.6,.6",
                "x is 0.6 and y 0.6, but y must be above 0 and x + y at most 1; are the columns those of "
                "the header?",
            ),
            (
                "south,black,0,40,1,.6,0",
                "x is 0.6 and y 0, but y must be above 0 and x + y at most 1; ar",
            ),
        ],
    )
    def test_a_line(self, tmp_path: Path, line: str, message: str) -> None:
        path = write(tmp_path, "# a remark", HEADER, "south,red,0,40,1,.7,.3", "", line)
        assert refused(path).startswith(f":5: {message}")

    @pytest.mark.parametrize("channel", ["X", "Z"])
    def test_negative_tristimulus(self, tmp_path: Path, channel: str) -> None:
        values = {"X": "-1,1,1", "Z": "1,1,-1"}[channel]
        path = write(tmp_path, TRISTIMULUS, f"south,red,0,40,{values}")
        assert refused(path) == (
            f":2: {channel} is -1; write 0 for a value below the meter's range"
        )

    @pytest.mark.parametrize(
        ("header", "message"),
        [
            ("patch,azimuth_deg,elevation_deg,Y,x,y", "projector"),
            ("projector,patch,azimuth_deg,elevation_deg,Y,x", "y"),
            ("projector,patch,azimuth_deg,elevation_deg,X,Y", "Z"),
            ("projector,patch,azimuth,elevation,Y,x,y", "azimuth_deg, elevation_deg"),
            (
                HEADER.replace(",", ";"),
                "projector, patch, azimuth_deg, elevation_deg, Y, x, y",
            ),
        ],
    )
    def test_a_missing_column(self, tmp_path: Path, header: str, message: str) -> None:
        path = write(tmp_path, "# a remark", header, "south,red,0,40,1,.7,.3")
        assert refused(path) == (
            f":2: the column {message} is missing; the first line must be {EXPECTED}, with commas between"
        )

    def test_a_column_twice(self, tmp_path: Path) -> None:
        path = write(tmp_path, f"{HEADER},Y", "south,red,0,40,1,.7,.3,1")
        assert refused(path) == ":1: there are two columns Y; remove one"

    def test_no_readings(self, tmp_path: Path) -> None:
        path = write(tmp_path, HEADER, "# nothing yet")
        assert refused(path) == f" holds no readings; it needs lines below {EXPECTED}"

    def test_an_empty_file(self, tmp_path: Path) -> None:
        assert refused(write(tmp_path, "")).startswith(":1: the column projector, patch,")

    def test_no_file(self, tmp_path: Path) -> None:
        path = tmp_path / "none.csv"
        assert refused(path) == f": no such file; it must hold {EXPECTED}"

    def test_no_text(self, tmp_path: Path) -> None:
        path = tmp_path / "book.xlsx"
        path.write_bytes(b"PK\x03\x04\xff\xfe\x00")
        text = refused(path)
        assert text.startswith(" is not a text file (invalid start byte); save it as CSV")
        assert text.endswith("save it as CSV in UTF-8")
