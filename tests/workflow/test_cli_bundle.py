"""`procam venue pack`: a session solved at another place gives the same maps; what the command refuses."""

import json
import shutil
from pathlib import Path

import pytest
from bundles import contents as contents_of
from bundles import relisted, write_zip
from tiny_venue import TINY_PAIR, contents, make_venue, procam, refused, take_session

from procam.files.session import Session
from procam.workflows import venue_rig

UNATTENDED = """
[unattended]
interlock = "{command}"
begin = "00:00"
end = "23:59"
notify = "{command}"
"""
pytestmark = pytest.mark.usefixtures("no_report")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A venue with a session that was solved."""
    folder = tmp_path_factory.mktemp("bundle") / "venue"
    take_session(make_venue(folder, size=TINY_PAIR))
    assert procam("session", "solve", folder / "sessions" / "0001").code == 0
    return folder


def test_a_bundle_solves_elsewhere_to_the_same_bits(
    solved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran = procam("venue", "pack", solved, tmp_path / "dome.zip")
    assert (ran.code, ran.err) == (0, "")
    assert f"{tmp_path / 'dome.zip'} written" in ran.out and "80 of 80 photographs" in ran.out
    assert "left out: tables of backends\n" in ran.out
    inspected = json.loads(procam("inspect", tmp_path / "dome.zip", "--json").out)
    assert inspected["kind"] == "bundle" and inspected["photographs"] == 80
    assert (inspected["projectors"], inspected["cameras"]) == (["north", "south"], ["zenith"])
    assert "tables of backends" in inspected["left_out"] and inspected["files"] > 80
    ran = procam("venue", "unpack", tmp_path / "dome.zip", tmp_path / "new", "--json")
    document = json.loads(ran.out)
    assert (ran.code, document["frames"]) == (0, 80)
    plans = [Session(d / "sessions" / "0001").read_plan() for d in (solved, tmp_path / "new")]
    assert plans[0] == plans[1]

    def no_device(*_: object) -> None:
        raise AssertionError("a device was opened")

    monkeypatch.setattr(venue_rig, "open_rig", no_device)
    assert procam("session", "solve", document["session"]).code == 0
    before, after = (
        contents(d / "calibrations" / "0001" / "maps") for d in (solved, tmp_path / "new")
    )
    assert before == after
    old, new = (
        json.loads((tmp_path / "new" / name / "calibration.json").read_text())
        for name in ("original", "calibrations/0001")
    )
    for quantity in ("feedback", "albedo"):
        assert old[quantity] == new[quantity]
    for name, figure in old["quality"].items():
        assert figure["value"] == new["quality"][name]["value"]


def test_commands_of_a_bundle_never_run(solved: Path, tmp_path: Path) -> None:
    venue, canary = tmp_path / "venue", tmp_path / "canary"
    shutil.copytree(solved, venue)
    with (venue / "venue.toml").open("a") as file:
        file.write(UNATTENDED.format(command=f"touch {canary}"))
    assert procam("venue", "pack", venue, tmp_path / "packed.zip").code == 0
    files = contents_of(tmp_path / "packed.zip")
    forged = files["venue.toml"].decode() + UNATTENDED.format(command=f"touch {canary}")
    write_zip(tmp_path / "forged.zip", relisted({**files, "venue.toml": forged.encode()}))
    for name in ("packed", "forged"):
        ran = procam("venue", "unpack", tmp_path / f"{name}.zip", tmp_path / name)
        assert ran.code == 0 and "left out: unattended" in ran.out
        assert procam("session", "solve", tmp_path / name / "sessions" / "0001").code == 0
        for command in ("verify", "recalibrate"):
            ran = procam(command, tmp_path / name, "--unattended")
            assert ran.code == 2 and "--unattended needs [unattended] with interlock" in ran.err
    assert not canary.exists()
    procam("verify", venue, "--unattended")  # the owner's own
    assert canary.exists()


def test_a_venue_stands_for_the_session_in_use(solved: Path, tmp_path: Path) -> None:
    venue, out = tmp_path / "venue", tmp_path / "out.zip"
    shutil.copytree(solved, venue)
    (venue / "sessions" / "0001").rename(venue / "sessions" / "0002")
    (venue / "sessions" / "0001").mkdir()
    shutil.copy(venue / "sessions" / "0002" / "plan.json", venue / "sessions" / "0001")
    ran = procam("venue", "pack", venue, out)
    assert ran.complaint.endswith(
        "sessions/0001: no frames are stored, so there is nothing to solve; give a "
        "session that was captured, and whose captures were not pruned"
    )
    shutil.rmtree(venue / "calibrations")
    ran = procam("venue", "pack", venue, out)
    assert "which of its sessions 0001, 0002 is meant; give a folder such as" in ran.complaint
    shutil.rmtree(venue / "sessions" / "0001")
    assert procam("venue", "pack", venue, out).code == 0


def test_a_damaged_calibration_in_use_is_named(solved: Path, tmp_path: Path) -> None:
    venue = tmp_path / "venue"
    shutil.copytree(solved, venue)
    (venue / "calibrations" / "0001" / "calibration.json").write_text("[]")
    complaint = procam("venue", "pack", venue, tmp_path / "out.zip").complaint
    assert "calibrations/0001/calibration.json is damaged (TypeError" in complaint
    assert "procam venue use " in complaint


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pack", "VENUE", "a.tar"], "its name must end in .zip; choose another OUT.zip"),
        (["pack", "EMPTY", "a.zip"], "there is no session here; give a folder such as VENUE/sess"),
        (["unpack", "no.zip", "new"], "no.zip: there is no such file or folder"),
    ],
)
def test_refusals(
    solved: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    named = [a.replace("VENUE", str(solved)).replace("EMPTY", "empty") for a in arguments]
    assert words in refused("venue", *named, "--json")
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]
