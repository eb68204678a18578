"""What a solve finds out reaches people, machines and the report, line by line."""

import json
import re
from pathlib import Path

import pytest
from tiny_venue import make_venue, procam, take_session

FIDUCIALS = re.compile(r"\[\[fiducials\]\]\n(?:\w.*\n)+")
POLE = "the dome's front and pole are not known: list two or more [[fiducials]] in venue.toml"
SIZE = "the dome's size is not known"
TAG = "tag 77: no camera sees it"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A captured venue whose venue.toml fixes nothing in space."""
    venue = make_venue(tmp_path_factory.mktemp("venue"))
    taken = take_session(venue).directory
    path = venue.directory / "venue.toml"
    text = FIDUCIALS.sub("", path.read_text("utf-8"))
    text = re.sub(r"^radius_m = .*\n", "", text, count=1, flags=re.MULTILINE)
    text = text.replace(
        'intrinsics = "prior"', 'intrinsics = "fixed"'
    )  # one small picture of one panel
    path.write_text(text + "\n[[apriltags]]\nid = 77\nazimuth_deg = 3\nsigma_deg = 0.1\n", "utf-8")
    return taken


def test_solve_says_it_and_the_report_repeats_it(session: Path) -> None:
    ran = procam("session", "solve", session)
    assert ran.code == 0, ran.err
    notes = [line for line in ran.out.splitlines() if line.startswith("note: ")]
    assert [any(part in note for note in notes) for part in (TAG, SIZE, POLE)] == [True] * 3
    assert procam("report", session.parents[1]).code == 0
    page = (session.parents[1] / "report.html").read_text("utf-8")
    assert "front and pole are not known" in page and "[[fiducials]]" in page


def test_machines_get_it_too(session: Path) -> None:
    document = json.loads(procam("session", "solve", session, "--json").out)
    assert any(POLE in note for note in document["notes"])
