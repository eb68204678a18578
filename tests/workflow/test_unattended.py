"""`--unattended`: the time, the interlock and the lamps are checked before anything is lit."""

import shutil
import sys
from collections.abc import Iterator
from datetime import time
from pathlib import Path

import pytest
from tiny_venue import (
    TINY_PAIR,
    Stage,
    make_venue,
    procam,
    quick_simulator,
    solved,
    take_session,
    watch_stage,
)

from procam.files.history.read import list_runs
from procam.files.venue.tables import UnattendedTable
from procam.workflows import unattended as module
from procam.workflows.unattended import _inside


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("unattended") / "venue"
    with quick_simulator():
        venue = make_venue(folder, size=TINY_PAIR)
        solved(venue, take_session(venue))
        yield folder


@pytest.fixture
def venue(once: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(once, tmp_path / "venue"))


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
    assert _inside(table, time.fromisoformat(now)) == inside


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
    ("keys", "words", "code"),
    [
        ({"interlock": '"false"'}, "interlock ended with 1: somebody may be in the dome", 2),
        ({"interlock": '"echo door is open; false"'}, "", 0),  # no shell: echo prints all of it
        ({"interlock": '"no-such-command-here"'}, "correct it in [unattended]", 2),
        ({"begin": '"03:00"', "end": '"03:00"'}, "from 03:00 to 03:00 only", 2),
        ({"power_on": "false"}, "does not allow to switch lamps on", 2),
    ],
)
def test_refused_before_anything_is_lit(
    keys: dict[str, str], words: str, code: int, venue: Path, stages: list[Stage]
) -> None:
    message = allow(venue, **keys)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == code
    if code:
        assert words in ran.complaint
        assert message.read_text().startswith("procam verify venue: failed: ")
        assert words in message.read_text()
        assert len(stages) <= 1  # opened to ask for the lamps at most
        assert list_runs(venue)[-1].outcome == "refused"
    assert all(not stage.lit() for stage in stages)


def test_an_interlock_that_does_not_answer(
    venue: Path, monkeypatch: pytest.MonkeyPatch, stages: list[Stage]
) -> None:
    allow(venue, interlock='"sleep 60"', notify='"true"')
    monkeypatch.setattr(module, "ANSWER_S", 0.2)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 1 and "did not end within 0.2 s" in ran.complaint and not stages


def test_somebody_comes_in_meanwhile(
    venue: Path, monkeypatch: pytest.MonkeyPatch, stages: list[Stage]
) -> None:
    door = venue.parent / "empty"
    door.touch()
    allow(venue, interlock=f'"test -e {door}"')
    monkeypatch.setattr(module, "INTERLOCK_EVERY_S", 0.0)
    asked = module._run

    def opened(command: list[str]) -> tuple[int, str]:
        answer = asked(command)
        door.unlink(missing_ok=True)  # after the first time
        return answer

    monkeypatch.setattr(module, "_run", opened)
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 2 and "somebody may be in the dome; all projectors are dark" in ran.complaint
    assert stages and all(not stage.lit() for stage in stages)


def test_needs_its_table(venue: Path) -> None:
    ran = procam("verify", venue, "--unattended")
    assert ran.code == 2 and "--unattended needs [unattended] with interlock" in ran.complaint


@pytest.mark.parametrize("wrong", ['"25:00"', '"3:00"', '"noon"'])
def test_times_that_are_none(wrong: str, venue: Path) -> None:
    allow(venue, begin=wrong)
    assert "unattended.begin" in procam("verify", venue, "--unattended").complaint
