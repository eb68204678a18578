"""The log of a run in the venue's folder."""

import re
from pathlib import Path

import pytest
from tiny_venue import TINY, make_venue, procam, quick_simulator

from procam.interfaces.cli import main
from procam.interfaces.cli._output import RunLog, end_log


@pytest.fixture
def venue(tmp_path: Path) -> Path:
    make_venue(tmp_path, size=TINY)
    return tmp_path


def logs(venue: Path) -> list[str]:
    return [path.read_text("utf-8") for path in sorted((venue / "logs").glob("*.log"))]


def test_a_run_keeps_what_it_said_and_how_it_ended(venue: Path) -> None:
    with quick_simulator():
        ran = procam("session", "capture", venue, "--json")
    assert ran.code == 0
    (text,) = logs(venue)
    first, *_, said, end = text.splitlines()
    assert re.fullmatch(
        rf"\d{{4}}-\d\d-\d\d \d\d:\d\d:\d\d  procam session capture {venue} --json", first
    )
    assert re.search(r"^ +\d+\.\d  capture 1/\d+ ", text, re.MULTILINE)
    assert "captured; now run: procam session solve" in said and end.endswith("exit code 0")


def test_an_error_is_its_last_line(venue: Path) -> None:
    with quick_simulator():
        procam("session", "capture", venue)
        (venue / "sessions" / "0001" / "captures" / "zenith" / "dark@0.13.tif").write_bytes(b"")
        ran = procam("session", "solve", venue / "sessions" / "0001")
    assert ran.code == 2
    last = logs(venue)[-1].splitlines()[-1]
    assert "exit code 2: " in last and "dark@0.13.tif" in last


def test_what_nobody_expected_is_kept_whole(venue: Path) -> None:
    def broken() -> None:
        RunLog(venue, "solve").write("started")
        raise ValueError("nobody expected this")

    with pytest.raises(ValueError, match="nobody"):
        main.main(broken)
    assert "Traceback" in logs(venue)[0] and "nobody expected this" in logs(venue)[0]


def test_without_a_line_there_is_no_file(venue: Path) -> None:
    RunLog(venue, "solve")
    end_log("exit code 2")
    assert not (venue / "logs").exists()
    ran = procam("session", "capture", venue, "--dry-run")
    assert ran.code == 0 and not (venue / "logs").exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_a_full_disk_ends_the_log_alone(venue: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = RunLog(venue, "solve")
    (venue / "logs").mkdir()
    monkeypatch.setattr(log, "_path", Path("/dev/full"))
    log.write("a")
    log.write("b")
    end_log("exit code 0")
    assert not list((venue / "logs").iterdir())
