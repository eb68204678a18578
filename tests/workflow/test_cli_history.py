"""`procam venue`: what it lists, compares, plots, exports, restores and deletes, and what it refuses."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import make_venue, procam, refused, take_session

from procam.files.history.record import recorded
from procam.files.images.pixels import read_header, write_image
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.workflows.capture.newest import newest_session


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A venue whose session was solved twice; one run was refused."""
    folder = tmp_path_factory.mktemp("history") / "venue"
    take_session(make_venue(folder))
    for _ in range(2):
        assert procam("session", "solve", folder / "sessions" / "0001").code == 0
    assert procam("state", folder, "full", "--photos", folder).code == 2
    return folder


@pytest.fixture
def venue(twice: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(twice, tmp_path / "venue"))


def test_lists_runs_and_calibrations(venue: Path) -> None:
    ran = procam("venue", "status", venue)
    assert ran.code == 0
    head, first, second, third, _, calibrations = ran.out.splitlines()
    assert head.split()[0] == "run"
    assert first.split()[0] == "1" and first.endswith("session solve    done     wrote 0001")
    assert second.endswith("session solve    done     wrote 0002")
    assert "state            refused  --photos is for venues" in third
    assert calibrations == "calibrations: 0001, 0002; 0002 is in use"
    document = json.loads(procam("venue", "status", venue, "--json").out)
    assert [run["outcome"] for run in document["runs"]] == ["done", "done", "refused"]
    assert document["in_use"] == "0002"


def test_compares_two_calibrations(venue: Path) -> None:
    ran = procam("venue", "compare", f"{venue}@1", f"{venue}@2")
    (row,) = (line for line in ran.out.splitlines() if line.startswith("  feedback.G"))
    assert row.split()[-2:] == ["0", "+0.0"]  # the same session
    document = json.loads(procam("venue", "compare", f"{venue}@1", f"{venue}@2", "--json").out)
    assert {"name": "feedback.R", "sigmas": 0.0} in [
        {"name": f["name"], "sigmas": f["sigmas"]} for f in document["figures"]
    ]


def test_a_calibration_edited_by_hand_is_named_and_built_upon_by_nothing(venue: Path) -> None:
    path = venue / "calibrations" / "0002" / "calibration.json"
    path.write_text(path.read_text() + "\n")
    assert "CHANGED  0002: calibration.json changed since procam wrote it" in (
        procam("venue", "status", venue).out
    )
    for command in (("refine", venue), ("state", venue, "full")):
        assert "0002/calibration.json changed since procam wrote it" in refused(*command)
    assert procam("venue", "use", f"{venue}@2").code == 2
    assert procam("venue", "use", f"{venue}@1").code == 0
    assert "0001 is in use" in procam("venue", "status", venue).out


def test_exports_and_plots(venue: Path, tmp_path: Path) -> None:
    out = tmp_path / "figures.csv"
    assert procam("venue", "show", venue, "--csv", out).code == 0
    assert sum(",feedback.G," in line for line in out.read_text().splitlines()) == 2
    plot = tmp_path / "trends.png"
    ran = procam("venue", "show", venue, "--plot", plot, "--figure", "feedback.G")
    assert ran.out.splitlines()[-1] == f"{plot} written: feedback.G"
    assert read_header(plot).width > 300
    assert f"{plot} written: feedback.R," in procam("venue", "show", venue, "--plot", plot).out


def test_shows_the_figures_of_one(venue: Path) -> None:
    ran = procam("venue", "show", f"{venue}@1")
    assert ran.out.startswith(f"{venue / 'calibrations' / '0001'}\n") and "coverage" in ran.out
    document = json.loads(procam("venue", "show", venue, "--json").out)
    assert document["calibration"] == str(venue / "calibrations" / "0002")
    assert document["figures"]["coverage"]["value"] > 0


def test_what_steers_a_terminal_is_written_out(tmp_path: Path) -> None:
    make_venue(tmp_path)
    with recorded(tmp_path, "solve\x1b[2J") as run:
        run.message = "\x1b]0;owned\x07 \u202eno\n   2  forged"
    ran = procam("venue", "status", tmp_path)
    (row,) = (line for line in ran.out.splitlines() if "solve" in line)
    assert row.endswith(r"solve\x1b[2J        done     \x1b]0;owned\x07 \u202eno    2  forged")
    (tmp_path / "venue.toml").write_text('"\\u001b[31m" = 1\n')
    ran = procam("session", "capture", tmp_path)
    assert r"\x1b[31m" in ran.err and "\x1b" not in ran.err + ran.out


class TestPrune:
    def test_keeps_the_newest_and_what_is_in_use(self, venue: Path) -> None:
        sessions = venue / "sessions"
        for number in (2, 3):
            shutil.copytree(sessions / "0001", sessions / f"000{number}")
        with (venue / "venue.toml").open("a") as file:
            file.write("\n[history]\nkeep_sessions = 1\n")
        ran = procam("venue", "prune", venue)
        assert ran.out.startswith("captures deleted: 0002, ")
        frames = {n: len([*(sessions / n).rglob("*.tif")]) for n in ("0001", "0002", "0003")}
        assert frames["0002"] == 0 and frames["0001"] == frames["0003"] > 0
        assert (sessions / "0002" / "captures" / "zenith" / "index.jsonl").is_file()
        assert procam("venue", "prune", venue).out == "captures deleted: nothing, 0.00 GB\n"

    def test_a_recalibration_that_failed_is_not_counted_nor_resumed(self, venue: Path) -> None:
        sessions = venue / "sessions"
        shutil.copytree(sessions / "0001", sessions / "0002")
        Session(sessions / "0001").without(sessions / "0003", ["south"])
        assert newest_session(load_venue(venue)) == sessions / "0004"
        with (venue / "venue.toml").open("a") as file:
            file.write("\n[history]\nkeep_sessions = 1\n")
        ran = procam("venue", "prune", venue)
        assert ran.out.startswith("captures deleted: 0003, ")
        frames = {n: len([*(sessions / n).rglob("*.tif")]) for n in ("0001", "0002", "0003")}
        assert frames["0003"] == 0 and frames["0001"] == frames["0002"] > 0

    def test_a_damaged_calibration_keeps_its_session(self, venue: Path) -> None:
        sessions = venue / "sessions"
        Session(sessions / "0001").without(sessions / "0002", ["south"])
        shutil.copytree(sessions / "0001", sessions / "0003")
        damaged = venue / "calibrations" / "0003" / "calibration.json"
        damaged.parent.mkdir()
        damaged.write_text('{"provenance": {"session": "00')
        (venue / "calibrations" / "in-use").write_text("0002\n")
        with (venue / "venue.toml").open("a") as file:
            file.write("\n[history]\nkeep_sessions = 3\n")
        before = len([*sessions.rglob("*.tif")])
        assert f"{damaged} is damaged" in refused("venue", "prune", venue)
        assert len([*sessions.rglob("*.tif")]) == before

    def test_what_was_deleted_is_said_where_it_is_needed(self, venue: Path) -> None:
        session = venue / "sessions" / "0001"
        for frame in session.rglob("*.tif"):
            frame.unlink()
        for command in (("session", "solve", session), ("verify", venue)):
            assert "its photographs were deleted, by `procam venue prune`" in refused(*command)
        assert newest_session(load_venue(venue)) == venue / "sessions" / "0002"
        ran = procam("venue", "use", f"{venue}@1")
        assert ran.code == 0 and "verify, recalibrate and solve cannot use it" in ran.err
        (note,) = json.loads(procam("venue", "use", f"{venue}@1", "--json").out)["notes"]
        assert "session 0001 are gone" in note

    def test_needs_a_policy(self, venue: Path) -> None:
        ran = procam("venue", "prune", venue)
        assert (ran.code, ran.complaint.split("; ")[1]) == (
            2,
            "add [history] with keep_sessions = 3, for the captures of the newest three and of the "
            "calibration in use",
        )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("compare", "VENUE@1", "VENUE@7"), "has no calibration 7, only 1, 2; choose one of them"),
        (("use", "VENUE@0"), "has no calibration 0, only 1, 2; choose one of them"),
        (("use", "VENUE@new"), "what follows @ is the number of a calibration, such as"),
        (("use", "VENUE"), "which of its calibrations? Choose from "),
        (("status", "VENUE@1"), "this command takes no calibration, but a venue"),
        (("show", "VENUE", "--figure", "feedback.G"), "--figure: it is for --plot FILE.png"),
        (("show", "VENUE", "--plot", "x.jpg"), "its name must end in .png; choose another --plot"),
        (("show", "VENUE", "--csv", "x.txt"), "its name must end in .csv; choose another --csv"),
    ],
)
def test_refused(arguments: tuple[str, ...], words: str, venue: Path, tmp_path: Path) -> None:
    given = (
        part.replace("VENUE", str(venue)).replace("OUT", str(tmp_path / "out"))
        for part in arguments
    )
    assert words in refused("venue", *given)


def test_every_command_takes_a_numbered_calibration(venue: Path, tmp_path: Path) -> None:
    sky = tmp_path / "sky.png"
    write_image(sky, np.full((64, 64, 3), 9999, np.uint16))
    for words in (
        ("compensate", f"{venue}@99", sky, tmp_path / "a.png"),
        ("preview", f"{venue}@99", sky, tmp_path / "a.html"),
        ("export", f"{venue}@99", "shader", sky, tmp_path / "out"),
        ("verify", f"{venue}@99"),
        ("refine", f"{venue}@99"),
        ("state", f"{venue}@99", "full"),
        ("meter", f"{venue}@99", sky),
        ("forecast", f"{venue}@99"),
        ("venue", "pack", f"{venue}@99", tmp_path / "a.zip"),
        ("venue", "show", f"{venue}@99"),
    ):
        assert "has no calibration 99, only 1, 2; choose one" in procam(*words).complaint, words
    for number in (1, 2):
        assert procam("compensate", f"{venue}@{number}", sky, tmp_path / f"{number}.png").code == 0


def test_a_calibration_is_put_in_use_from_within_its_folder(
    venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(venue / "calibrations" / "0001")
    assert procam("venue", "use", ".").code == 0
    assert "0001 is in use" in procam("venue", "status", venue).out


def test_a_calibration_that_is_in_no_venue(venue: Path, tmp_path: Path) -> None:
    stray = shutil.copytree(venue / "calibrations" / "0001", tmp_path / "away" / "x" / "0001")
    before = sorted(tmp_path.rglob("*"))
    for words in (
        ("venue", "use", stray),
        ("meter", stray, venue / "venue.toml"),
        ("refine", stray),
    ):
        assert "this calibration is in no venue; give one such as" in procam(*words).complaint
    assert sorted(tmp_path.rglob("*")) == before
    assert procam("venue", "show", stray).code == 0


def test_a_session_that_is_gone_is_said(venue: Path, tmp_path: Path) -> None:
    (venue / "sessions" / "0001").rename(venue / "sessions" / "0002")
    assert "session 0001 of that calibration is gone; restore it" in refused(
        "venue", "pack", venue, tmp_path / "a.zip"
    )
    assert (
        "the photographs of its session 0001 are gone" in procam("venue", "use", f"{venue}@1").err
    )


def test_what_cannot_be_plotted(venue: Path, tmp_path: Path) -> None:
    plot = ("venue", "show", venue, "--plot", tmp_path / "a.png")
    ran = procam(*plot, "--figure", "lamp")
    assert ran.code == 2 and "lamp: no run has measured it; choose from " in ran.err
    (venue / "history.sqlite").unlink()
    shutil.rmtree(venue / "calibrations" / "0002")
    ran = procam(*plot)
    assert ran.code == 2 and "--plot: no figure was measured twice yet" in ran.err


def test_a_folder_in_place_of_the_history(tmp_path: Path) -> None:
    make_venue(tmp_path)
    (tmp_path / "history.sqlite").mkdir()
    assert refused("venue", "status", tmp_path) == (
        f"procam: {tmp_path / 'history.sqlite'} is a folder, and the venue's history is a file of that "
        "name; move the folder away"
    )
    assert "history.sqlite is a folder" in refused("calibrate", tmp_path)
    assert not (tmp_path / "sessions").exists()


def test_no_venue(tmp_path: Path) -> None:
    assert procam("venue", "status", tmp_path).complaint.endswith("give a folder with a venue.toml")
