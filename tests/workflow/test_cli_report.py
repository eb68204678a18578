"""`procam report`: the client's limits decide its exit code; the operators' sheet; stills to judge by eye."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import TINY, calibrated, make_venue, procam, refused, solved

from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.workflows.capture.newest import capture_newest
from simulators.placement import place_cameras
from simulators.template import venue_text

PAIR = replace(TINY, cameras=2)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A venue with one calibration."""
    return calibrated(tmp_path_factory.mktemp("report") / "venue").directory


def _limit(venue: Path, *lines: str) -> None:
    with (venue / "venue.toml").open("a") as file:
        file.write("\n[acceptance]\n" + "\n".join(lines) + "\n")


def _calibrate_from_second_seat(venue: Path) -> None:
    """Calibrate again, by a camera that stands elsewhere, with the marks that it sees."""
    head, *tables = re.split(r"(?m)^(?=\[)", venue_text("standard", PAIR))
    kept = [t for t in tables if "[cameras.zenith]" not in t and 'camera = "zenith"' not in t]
    (venue / "venue.toml").write_text(head + "".join(kept) + "session = 1\n", "utf-8")
    loaded = load_venue(venue)
    solved(loaded, result_of(capture_newest(loaded)))


def test_without_limits_it_is_written_and_accepted(venue: Path) -> None:
    ran = procam("report", venue)
    pages = ("report.html", "operator-sheet.html")
    assert (ran.code, ran.out.splitlines()) == (0, [f"{venue / page} written" for page in pages])
    _limit(venue)
    ran = procam("report", venue, "--json")
    assert ran.code == 0 and json.loads(ran.out)["acceptance"] == {}


def test_limits_that_are_kept(venue: Path) -> None:
    _limit(venue, "feedback = 0.9", "coverage = 0.1")
    ran = procam("report", venue)
    assert ran.code == 0
    coverage, feedback, outcome, written, _ = ran.out.splitlines()
    assert coverage.startswith("  pass       coverage: ") and "; at least 10" in coverage
    assert feedback.startswith("  pass       feedback: red 0.")
    assert outcome == "All 2 limits of the client are kept."
    assert written == f"{venue / 'report.html'} written"


@pytest.mark.parametrize(
    ("line", "verdict"), [("coverage = 1", "fail"), ("loop_own_jnd = 1.0", "not shown")]
)
def test_one_that_is_missed_or_not_shown_ends_with_1(venue: Path, line: str, verdict: str) -> None:
    _limit(venue, "feedback = 0.9", line)
    ran = procam("report", venue, "--json")
    found = json.loads(ran.out)["acceptance"]
    name = line.split(maxsplit=1)[0]
    assert ran.code == 1 and found[name]["verdict"] == verdict
    assert found["feedback"]["verdict"] == "pass" and len(found["feedback"]["high"]) == 3
    assert "Acceptance by the client's limits" in (venue / "report.html").read_text()


def test_a_second_seat_confirms_the_first(venue: Path) -> None:
    assert json.loads(procam("report", venue, "--json").out)["other_seat"] is None
    _calibrate_from_second_seat(venue)
    assert procam("venue", "use", f"{venue}@1").code == 0
    _limit(
        venue,
        "other_seat_direction_relative_over_sigma = 2",
        "other_seat_feedback = 0.05",
        "other_seat_solid_angle_sum = 1e-9",
    )
    ran = procam("report", venue, "--json")
    document = json.loads(ran.out)
    verdicts = [entry["verdict"] for entry in document["acceptance"].values()]
    assert (ran.code, verdicts) == (1, ["pass", "fail", "pass"])  # no area agrees to 1e-9
    check = document["other_seat"]
    assert check["calibration"] == str(venue / "calibrations" / "0002")
    assert (check["camera"], check["agrees"]) == ("second", True)
    builds = place_cameras(2, PAIR.camera_size, PAIR.camera_kind)
    first, second = (build.camera_from_dome.origin for build in builds)
    assert check["distance_m"] == pytest.approx(np.linalg.norm(first - second), rel=0.02)
    assert "The two agree within their error bars." in (venue / "report.html").read_text("utf-8")


def test_sheet_and_stills_beside_the_report(venue: Path, tmp_path: Path) -> None:
    _limit(venue)
    folder = tmp_path / "stills"
    ran = procam("report", venue, "--stills", folder, "--json")
    sheet, index = venue / "operator-sheet.html", folder / "index.txt"
    assert ran.code == 0
    document = json.loads(ran.out)
    assert (document["sheet"], document["stills"]) == (str(sheet), str(index))
    assert f"procam verify {venue}" in sheet.read_text() and index.is_file()
    assert (venue / "report.html").is_file()
    assert (folder / "dome-masters" / "grid.compensated.png").is_file()


def test_a_venue_without_a_calibration_has_no_stills(tmp_path: Path) -> None:
    make_venue(tmp_path / "new")
    assert "has no calibration" in refused(
        "report", tmp_path / "new", "--stills", tmp_path / "stills"
    )
    assert not (tmp_path / "stills").exists()
