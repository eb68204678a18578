"""Rigs that procam does not drive: what is refused leaves nothing behind, and says what to try."""

import json
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import CAMERA, TINY, make_venue, procam, refused, solved

from procam.errors import FileFormatError
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.interfaces.cli._system_errors import worded
from procam.model.frame import CameraSettings, Frame
from procam.workflows.capture.photo_index import _index_lines


@pytest.fixture
def venue(tmp_path: Path) -> Venue:
    return make_venue(tmp_path / "dome", size=TINY)


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    """A regular file where somebody takes it for a folder."""
    path = tmp_path / "notes.txt"
    path.write_text("x")
    return path


class TestAFileOnTheWay:
    @pytest.mark.parametrize("under", ["sub", "sub/deeper"])
    def test_patterns_leave_no_session(self, venue: Venue, notes: Path, under: str) -> None:
        for more in ((), ("--movie",)):
            if more:
                pytest.importorskip("av", reason="needs the extra `video`")
            assert "a file is where a folder must be" in refused(
                "session", "plan", venue.directory, notes / under, *more
            )
            assert not (venue.directory / "sessions").exists()

    def test_other_commands(self, notes: Path) -> None:
        for command in (
            ("init", notes, "--template", "simulated-standard"),
            ("init", notes / "sub", "--template", "simulated-standard"),
            ("lens", "patterns", notes, "--size", "64x40"),
            ("lens", "patterns", notes / "sub", "--size", "64x40"),
        ):
            complaint = refused(*command)
            assert "notes.txt" in complaint
            assert "Errno" not in complaint
            assert "folder" in complaint


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError(28, "No space left on device"), "disk: the disk is full; free some"),
        (PermissionError(13, "Permission denied", "/root/a"), "/root/a: there is no permission"),
        (
            OSError(5, "Input/output error", "a.tif"),
            "a.tif: the system refuses to read or write (Input/output err",
        ),
        (
            OSError(21, "Is a directory", ".a.exr.tmp.exr", None, "a.exr"),
            "a.exr: this is a folder, and a file is needed",
        ),
        (OSError("cable pulled"), "cable pulled"),
    ],
)
def test_the_systems_errors_in_words(error: OSError, line: str) -> None:
    assert worded(error).startswith(line)


class TestIndex:
    def test_what_a_spreadsheet_calls_unicode_text(self, tmp_path: Path) -> None:
        index = tmp_path / "index.csv"
        index.write_bytes("file,shot\nimg_1.tif,dark\n".encode("utf-16"))
        with pytest.raises(FileFormatError, match="not UTF-8 text") as message:
            _index_lines(index)
        assert "\n" not in str(message.value)

    def test_a_byte_order_mark_does_no_harm(self, tmp_path: Path) -> None:
        index = tmp_path / "index.csv"
        index.write_text("file,shot\nimg_1.tif,dark\n", "utf-8-sig")
        assert _index_lines(index) == [["img_1.tif", "dark"]]


def test_a_solve_names_the_photographs_that_are_missing(venue: Venue) -> None:
    ran = procam("session", "plan", venue.directory, venue.directory / "out", "--json")
    session = Session(Path(json.loads(ran.out)["session"]))
    plan = session.read_plan()
    counts = np.zeros((TINY.camera_size[1], TINY.camera_size[0]), np.uint16)
    left_out = plan.shots[3:10]
    for shot in plan.shots:
        for exposure in shot.exposures_s if shot not in left_out else ():
            pixels = counts if shot.pixel_format == "mono" else np.stack(3 * [counts], axis=-1)
            frame = Frame(pixels, CameraSettings(exposure, shot.pixel_format), 0.0, exposure)
            session.store(CAMERA, shot, exposure, frame)
    with pytest.raises(FileFormatError) as message:
        solved(venue, session)
    named = ", ".join(shot.id for shot in left_out[:5])
    assert f"hand-0001: no photographs by camera {CAMERA} of {named} and 2 more" in str(
        message.value
    )
    assert "photograph them and `procam session add` again" in str(message.value)
