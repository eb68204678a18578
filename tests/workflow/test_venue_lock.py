"""While one process works on a venue, every command that writes it or lights its projectors is refused."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tiny_venue import contents, make_venue, procam, quick_simulator, solved, take_session

from procam.files.venue.load import load_venue
from procam.workflows.capture.newest import newest_session
from studies.two_at_once import run_both

HOLD = """
import sys
from pathlib import Path
from procam.files.lock import locked
with locked(Path(sys.argv[1]), "refine"):
    print("held", flush=True)
    sys.stdin.read()
"""
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
    with quick_simulator():
        venue = make_venue(tmp_path_factory.mktemp("ready") / "venue")
        solved(venue, take_session(venue))
    return venue.directory


@pytest.fixture(scope="module")
def busy(ready: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A calibrated venue that another process holds."""
    folder = shutil.copytree(ready, tmp_path_factory.mktemp("busy") / "venue")
    command = [sys.executable, "-c", HOLD, str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout and other.stdout.readline() == b"held\n"
        yield folder
        other.kill()


@pytest.mark.parametrize("command", COMMANDS)
def test_refused_by_name_and_nothing_is_written(command: str, busy: Path) -> None:
    before = contents(busy)
    arguments = (part.replace("VENUE", str(busy)) for part in COMMANDS[command])
    ran = procam(*command.split(), *arguments)
    assert ran.code == 2
    assert f"{busy}: `procam refine` (process " in ran.complaint
    assert ran.complaint.endswith("is at work there; wait until it has ended, or stop it")
    assert contents(busy) == before


def test_a_number_is_never_used_again(ready: Path, tmp_path: Path) -> None:
    sessions = shutil.copytree(ready, tmp_path / "venue") / "sessions"
    (sessions / "0001").rename(sessions / "0003")
    with quick_simulator():
        assert newest_session(load_venue(sessions.parent)).name == "0004"


def test_two_at_once(ready: Path, tmp_path: Path) -> None:
    shutil.copytree(ready, tmp_path / "venue")
    assert "worked" in run_both(tmp_path / "venue", ("session solve", "session capture"))
