"""While one process works on a venue, every command that writes it or lights its projectors is refused."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from held_folder import held_by
from tiny_venue import calibrated, contents, refused

from procam.files.venue.load import load_venue
from procam.workflows.capture.newest import newest_session
from studies.two_at_once import run_both

COMMANDS = {
    "session capture": ("VENUE",),
    "calibrate": ("VENUE",),
    "session solve": ("VENUE/sessions/0001",),
    "session add": ("VENUE/sessions/0001", "--camera", "zenith", "--photos", "VENUE"),
    "refine": ("VENUE",),
    "state": ("VENUE", "full"),
    "doctor": ("VENUE",),
    "projector": ("VENUE", "south", "state"),
    "session plan": ("VENUE", "VENUE/out"),
    "venue use": ("VENUE@1",),
    "meter": ("VENUE", "VENUE/readings.csv"),
    "verify": ("VENUE",),
    "recalibrate": ("VENUE",),
}


@pytest.fixture(scope="module")
def ready(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibrated venue."""
    return calibrated(tmp_path_factory.mktemp("ready") / "venue").directory


@pytest.fixture(scope="module")
def busy(ready: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A calibrated venue that another process holds."""
    folder = shutil.copytree(ready, tmp_path_factory.mktemp("busy") / "venue")
    with held_by("refine", folder):
        yield folder


@pytest.mark.parametrize("command", COMMANDS)
def test_refused_by_name_and_nothing_is_written(command: str, busy: Path) -> None:
    before = contents(busy)
    arguments = (part.replace("VENUE", str(busy)) for part in COMMANDS[command])
    complaint = refused(*command.split(), *arguments)
    assert f"{busy}: `procam refine` (process " in complaint
    assert complaint.endswith("is at work there; wait until it has ended, or stop it")
    assert contents(busy) == before


def test_a_number_is_never_used_again(ready: Path, tmp_path: Path) -> None:
    sessions = shutil.copytree(ready, tmp_path / "venue") / "sessions"
    (sessions / "0001").rename(sessions / "0003")
    assert newest_session(load_venue(sessions.parent)).name == "0004"


def test_two_at_once(ready: Path, tmp_path: Path) -> None:
    shutil.copytree(ready, tmp_path / "venue")
    assert "worked" in run_both(tmp_path / "venue", ("session solve", "session capture"))
