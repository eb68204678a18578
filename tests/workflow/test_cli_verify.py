"""`procam verify`: exit codes, what it prints and records, by hand too, and what it refuses."""

import errno
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import TINY_PAIR, calibrated, drift, procam, refused

from procam.files.calibration import load_calibration, save_calibration
from procam.files.history import record

SIZE = replace(TINY_PAIR, projector_size=(160, 100), camera_size=(256, 256), map_size=256)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return calibrated(tmp_path_factory.mktemp("verify") / "venue", SIZE).directory


def test_all_is_well(venue: Path) -> None:
    drift(venue)
    ran = procam("verify", venue)
    assert (ran.code, ran.out) == (
        0,
        "11 photographs, compared with calibration 0001: all is well\n",
    )
    assert "verify           done     nothing has changed" in procam("venue", "status", venue).out


def test_changes_are_named_recorded_and_end_with_1(venue: Path) -> None:
    drift(
        venue,
        '{ kind = "aged", projector = "north", size = 0.2 }',
        '{ kind = "camera-moved", size = 1.0, angle_deg = 30 }',
    )
    ran = procam("verify", venue)
    assert ran.code == 1
    first, *_ = ran.out.splitlines()
    assert first.startswith("note     zenith: camera moved  +1 +- ")
    assert "CHANGED  north: light  -0.2 +- " in ran.out
    assert ran.out.endswith("compared with calibration 0001: 1 change\n")
    document = json.loads(procam("verify", venue, "--json").out)
    assert document["alarm"] is True
    assert [(each["cause"], each["alarm"]) for each in document["findings"]] == [
        ("camera moved", False),
        ("light", True),
    ]
    listed = procam("venue", "status", venue).out
    assert listed.count("verify           done     zenith camera moved, north light") == 2
    csv = venue / "out.csv"
    procam("venue", "show", venue, "--csv", csv)
    rows = [line.split(",") for line in csv.read_text().splitlines()]
    light = [float(row[6]) for row in rows if row[5] == "light.north.G"]
    assert light == pytest.approx([0.8, 0.8], abs=0.01)


def test_a_camera_put_back_roughly_is_no_alarm(venue: Path) -> None:
    drift(venue, '{ kind = "camera-moved", size = 1.5, angle_deg = 200 }')
    ran = procam("verify", venue)
    assert ran.code == 0 and "camera moved" in ran.out
    assert ran.out.endswith("compared with calibration 0001: all is well\n")


def test_a_calibration_that_blacks_a_projector_out(venue: Path) -> None:
    """Every photograph is as it was; the calibration itself is wrong, as earlier versions wrote some."""
    first = venue / "calibrations" / "0001"
    calibration = load_calibration(first)
    north = calibration.projectors["north"]
    dark = replace(north, blend=np.zeros_like(north.blend))
    shutil.rmtree(first)
    (venue / "history.sqlite").unlink()  # which knows the files
    save_calibration(
        replace(calibration, projectors={**calibration.projectors, "north": dark}), first
    )
    ran = procam("verify", venue)
    assert ran.code == 1
    assert "CHANGED  venue: calibration" in ran.out
    said = " ".join(ran.out.split())
    assert (
        "north from 0% what to do: calibrate again: procam calibrate" in said and "nan" not in said
    )


def test_no_disk_takes_the_findings_away(venue: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is full when all is measured, and the run is to be recorded."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(venue / "history.sqlite"))

    drift(venue, '{ kind = "aged", projector = "north", size = 0.2 }')
    monkeypatch.setattr(record, "_end", full)
    ran = procam("verify", venue)
    assert ran.code == 2
    assert "CHANGED  north: light  -0.2 +- " in ran.out
    assert "after them:" in ran.err and "history.sqlite: the disk is full" in ran.err
    document = json.loads(procam("verify", venue, "--json").out)
    assert document["alarm"] is True and "the disk is full" in document["error"]


def test_what_has_no_size_is_null_in_json(venue: Path) -> None:
    drift(venue, '{ kind = "no-picture", projector = "south", size = 1 }')
    (found,) = json.loads(procam("verify", venue, "--json").out)["findings"]
    assert (found["cause"], found["size"], found["sigmas"]) == ("no picture", None, None)


class TestRefused:
    def test_an_edited_calibration(self, venue: Path) -> None:
        procam("venue", "use", f"{venue}@1")  # a run records what is there
        path = venue / "calibrations" / "0001" / "calibration.json"
        path.write_text(path.read_text() + "\n")
        assert "calibration.json changed since procam wrote it" in refused("verify", venue)

    def test_a_session_that_is_gone(self, venue: Path) -> None:
        shutil.rmtree(venue / "sessions")
        assert "the session of the calibration in use is gone" in refused("verify", venue)

    def test_other_devices(self, venue: Path) -> None:
        path = venue / "venue.toml"
        path.write_text(path.read_text().replace("[projectors.north]", "[projectors.nord]"))
        assert procam("verify", venue).code == 2
