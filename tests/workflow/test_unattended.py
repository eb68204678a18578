"""`--unattended`: the time, the interlock and the lamps are checked before anything is lit."""

import os
import signal
import sys
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from queue import SimpleQueue

import pytest
from tiny_venue import (
    TINY_PAIR,
    Stage,
    calibrated,
    procam,
    refused,
    replace_camera,
    watch_stage,
)

from procam.devices.interrupts import SIGNALS
from procam.devices.protocols import BackendRig, Camera, Power
from procam.errors import DeviceError
from procam.files.history.read import list_runs
from procam.files.venue.tables import UnattendedTable
from procam.model.frame import Frame
from procam.workflows import unattended as module
from procam.workflows import watchdog
from procam.workflows.unattended import _inside
from simulators.faults import FaultyCamera

STUCK_S = 120.0


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return calibrated(tmp_path_factory.mktemp("unattended") / "venue", TINY_PAIR).directory


@pytest.fixture
def stages(monkeypatch: pytest.MonkeyPatch) -> list[Stage]:
    return watch_stage(monkeypatch)


def allow(venue: Path, **keys: str) -> Path:
    """Write [unattended]; returns the file that the notification writes."""
    message = venue.parent / "message.txt"
    notify = f"{sys.executable} -c 'import sys; open(sys.argv[1], \\\"a\\\").write(sys.argv[2])' {message}"
    table = {"interlock": '"true"', "begin": '"00:00"', "end": '"23:59"', "power_on": "true"}
    table |= {"notify": f'"{notify}"'} | keys
    path = venue / "venue.toml"
    lines = "\n".join(f"{key} = {value}" for key, value in table.items())
    path.write_text(f"{path.read_text()}\n[unattended]\n{lines}\n")
    return message


@pytest.mark.parametrize(
    ("now", "begin", "end", "inside"),
    [
        ("03:00", "03:00", "05:30", True),
        ("05:30", "03:00", "05:30", False),
        ("02:59", "03:00", "05:30", False),
        ("23:30", "23:00", "01:00", True),
        ("00:59", "23:00", "01:00", True),
        ("01:00", "23:00", "01:00", False),
        ("12:00", "23:00", "01:00", False),
    ],
)
def test_the_window(now: str, begin: str, end: str, inside: bool) -> None:
    table = UnattendedTable(interlock="true", begin=begin, end=end)
    assert _inside(table, datetime.fromisoformat(f"2026-01-01T{now}").time()) == inside


def test_all_is_well_and_a_message_is_sent(venue: Path, stages: list[Stage]) -> None:
    message = allow(venue)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 0, ran
    assert message.read_text() == "procam verify venue: nothing has changed"
    assert all(not stage.lit() for stage in stages)


def test_recalibration_with_nothing_to_do(venue: Path) -> None:
    message = allow(venue)
    assert procam("recalibrate", venue, "--unattended").code == 0
    assert message.read_text() == "procam recalibrate venue: nothing to recalibrate"


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"interlock": '"false"'}, "interlock ended with 1: somebody may be in the dome"),
        (
            {"interlock": "\"sh -c 'echo door is open; exit 3'\""},
            "ended with 3 (door is open): somebody",
        ),
        ({"interlock": "\"sh -c 'kill -9 $$'\""}, "interlock ended with -9: somebody may be"),
        ({"interlock": '"no-such-command-here"'}, "unattended.interlock cannot be run"),
        ({"begin": '"03:00"', "end": '"03:00"'}, "from 03:00 to 03:00 only"),
        ({"power_on": "false"}, "does not allow to switch lamps on"),
    ],
)
@pytest.mark.parametrize("command", ["verify", "recalibrate"])
def test_refused_before_anything_is_lit(
    command: str, keys: dict[str, str], words: str, venue: Path, stages: list[Stage]
) -> None:
    message = allow(venue, **keys)
    ran = procam(command, venue, "--unattended")
    assert ran.code == 2
    assert words in ran.complaint
    assert message.read_text().startswith(f"procam {command} venue: failed: ")
    assert words in message.read_text()
    assert len(stages) <= 1  # opened to ask for the lamps at most
    assert ("dark" in ran.complaint) <= bool(stages)  # what was not asked is not called dark
    assert list_runs(venue)[-1].outcome == "refused"
    assert all(not stage.lit() for stage in stages)


@pytest.mark.parametrize("command", ["verify", "recalibrate"])
def test_a_calibration_that_cannot_be_read_is_in_the_message(
    command: str, venue: Path, stages: list[Stage]
) -> None:
    message = allow(venue)
    next(venue.glob("calibrations/*/calibration.json")).write_text("{}")
    assert "calibration.json" in refused(command, venue, "--unattended")
    assert message.read_text().startswith(f"procam {command} venue: failed: ")
    assert all(not stage.lit() for stage in stages)


@pytest.mark.parametrize("key", ["interlock", "notify"])
@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("true && false", "'&&' means nothing: write a script and give its path"),
        ("ask 'door", "a quote or backslash is left open"),
        ("", "all of them printable"),
    ],
)
def test_commands_are_checked_when_venue_toml_is_read(
    key: str, command: str, words: str, venue: Path, stages: list[Stage]
) -> None:
    allow(venue, **{key: f'"{command}"'})
    complaint = refused("verify", venue)
    assert f"unattended.{key} is " in complaint
    assert words in complaint
    assert not stages


def test_an_interlock_that_does_not_answer(
    venue: Path, monkeypatch: pytest.MonkeyPatch, stages: list[Stage]
) -> None:
    allow(venue, interlock='"sleep 60"', notify='"true"')
    for each in (module, watchdog):
        monkeypatch.setattr(each, "LATE_S", 0.2)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 1 and "gave no answer within 0.2 s: somebody may be" in ran.complaint
    assert not stages


class Meanwhile(FaultyCamera):
    """A camera whose third photograph is not there before something has happened."""

    def __init__(self, camera: Camera, happens: Callable[[], None]) -> None:
        super().__init__(camera)
        self._happens, self._count = happens, 0

    def capture(self) -> Frame:
        self._count += 1
        if self._count == 3:
            self._happens()
        return super().capture()


def with_camera(monkeypatch: pytest.MonkeyPatch, happens: Callable[[Stage], None]) -> list[Stage]:
    """Stages whose camera has something happen before its third photograph."""

    def alter(stage: Stage) -> BackendRig:
        return replace_camera(stage.backend, lambda c: Meanwhile(c, lambda: happens(stage)))

    return watch_stage(monkeypatch, alter)


def wait_until_dark(stage: Stage) -> float:
    """As a camera that hangs; how long it was [s]."""
    began = time.monotonic()
    assert stage.lit()
    while stage.lit() and time.monotonic() - began < STUCK_S:
        time.sleep(0.01)
    return time.monotonic() - began


@pytest.mark.parametrize("command", ["verify", "recalibrate"])
@pytest.mark.parametrize("answer", ["no", "late", "gone"])
def test_light_goes_while_the_camera_hangs(
    command: str, answer: str, venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script, lit_s = venue.parent / "interlock", list[float]()
    script.write_text("#!/bin/sh\n")
    script.chmod(0o755)
    message = allow(venue, interlock=f'"{script}"')

    def happens(stage: Stage) -> None:
        if answer == "gone":
            script.unlink()
        else:
            script.write_text("#!/bin/sh\n" + ("exit 1" if answer == "no" else "sleep 60\n"))
        lit_s.append(wait_until_dark(stage))

    stages = with_camera(monkeypatch, happens)
    only = ["--projector", "south"] if command == "recalibrate" else []
    ran = procam(command, venue, "--unattended", *only)
    assert len(lit_s) == 1
    assert lit_s[0] < STUCK_S  # the study measures how soon
    said = ran.err.splitlines()[-1]
    assert ran.code == (1 if answer == "late" else 2)
    assert said.endswith("; all projectors are dark")
    assert f"procam {command} venue: failed: {said.removeprefix('procam: ')}" == message.read_text()
    assert len(stages) == 1 and not stages[0].lit()  # one rig, opened once
    assert all(state.power is not Power.ON for state in stages[0].scene.states.values())


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("command", ["verify", "recalibrate"])
def test_a_signal_is_in_the_message(
    command: str, number: int, venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    message = allow(venue)
    stages = with_camera(monkeypatch, lambda _: os.kill(os.getpid(), number))
    signal.signal(number, signal.default_int_handler)
    ran = procam(command, venue, "--unattended")
    name = signal.Signals(number).name
    assert ran.code == 128 + number and "stopped; all projectors are dark." in ran.err
    assert message.read_text() == (
        f"procam {command} venue: failed: stopped by {name}; all projectors are dark"
    )
    assert not stages[0].lit()


def test_an_error_of_a_run_is_in_the_message(venue: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def happens(_: Stage) -> None:
        raise DeviceError("camera zenith does not answer")

    message = allow(venue)
    with_camera(monkeypatch, happens)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 1 and ran.err.splitlines()[-1] == "procam: camera zenith does not answer"
    assert message.read_text() == (
        "procam verify venue: failed: camera zenith does not answer; all projectors are dark"
    )


def test_a_projector_that_stays_lit_is_named_and_nothing_is_called_dark(
    venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    door = venue.parent / "empty"
    door.touch()
    message = allow(venue, interlock=f'"test -e {door}"')

    def happens(stage: Stage) -> None:
        for state in stage.scene.states.values():
            state.shutter_stuck = True
        door.unlink()
        time.sleep(2 * watchdog.ASK_EVERY_S)

    with_camera(monkeypatch, happens)
    ran = procam("verify", venue, "--unattended")
    said = ran.err.splitlines()[-1]
    assert ran.code == 1 and "somebody may be in the dome; a projector may still be lit" in said
    assert "are dark" not in said + message.read_text()
    assert message.read_text().endswith(said.removeprefix("procam: "))


@pytest.mark.parametrize(
    ("notify", "words"),
    [
        ("false", "unattended.notify ended with 1; the message was: procam verify venue: nothing"),
        ("sh -c 'sleep 60'", "unattended.notify did not end within 0.5 s; the message was"),
        ("no-such-program", "unattended.notify cannot be run"),
    ],
)
def test_a_notification_that_fails_is_said_and_changes_no_exit_code(
    notify: str,
    words: str,
    venue: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    allow(venue, notify=f'"{notify}"')
    monkeypatch.setattr(module, "NOTIFY_S", 0.5)
    assert procam("verify", venue, "--unattended").code == 0
    assert words in capfd.readouterr().err


def test_a_run_that_does_not_end_is_ended(
    venue: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    door, ended = venue.parent / "empty", SimpleQueue[int]()
    door.touch()
    message = allow(venue, interlock=f'"test -e {door}"')
    monkeypatch.setattr(watchdog, "END_S", 0.1)
    monkeypatch.setattr(os, "_exit", ended.put)

    def happens(stage: Stage) -> None:
        door.unlink()
        assert ended.get(timeout=STUCK_S) == 2
        assert not stage.lit()

    with_camera(monkeypatch, happens)
    procam("verify", venue, "--unattended")
    said = capfd.readouterr().err
    assert "all projectors are dark; waiting for the run to end" in said
    assert (
        "all projectors are dark. A device or a disk does not answer: the process is ended" in said
    )
    assert message.read_text().count("procam verify venue: failed: ") == 1


def test_the_time_ends_meanwhile(venue: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    allow(venue)

    def happens(stage: Stage) -> None:
        monkeypatch.setattr(module, "_inside", lambda *_: False)
        assert wait_until_dark(stage) < STUCK_S

    with_camera(monkeypatch, happens)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 2 and "23:59 only. Run it then; all projectors are dark" in ran.err


def test_needs_its_table(venue: Path) -> None:
    assert "--unattended needs [unattended] with interlock" in refused(
        "verify", venue, "--unattended"
    )


@pytest.mark.parametrize("wrong", ['"25:00"', '"3:00"', '"noon"'])
def test_times_that_are_none(wrong: str, venue: Path) -> None:
    allow(venue, begin=wrong)
    assert "unattended.begin" in procam("verify", venue, "--unattended").complaint
