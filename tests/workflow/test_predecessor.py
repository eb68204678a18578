"""Which calibration of a venue counts: the newest, one that was chosen, never one that contradicts it."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exact_room import coarse_rooms
from tiny_venue import TINY_PAIR, Ran, calibrated, procam, quick_simulator, refused

from procam.files.calibration import load_calibration, save_calibration
from procam.files.images.pixels import write_image
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.files.versions import calibration_in_use
from procam.model.photometry import AbsoluteColour
from procam.model.venue_state import VenueState


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A venue with two projectors, captured and calibrated."""
    with coarse_rooms(), quick_simulator():
        return calibrated(tmp_path_factory.mktemp("pair") / "venue", TINY_PAIR).directory


@pytest.fixture(scope="module")
def twice(once: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Ran]:
    """The same solved again, and what that said."""
    folder = Path(shutil.copytree(once, tmp_path_factory.mktemp("twice") / "venue"))
    return folder, procam("session", "solve", folder / "sessions" / "0001", "--json")


def exchange_projectors(venue: Path) -> Path:
    """A second session, in which each projector's photographs lie behind the other's shots."""
    old, new = venue / "sessions" / "0001", venue / "sessions" / "0002"
    shutil.copytree(old, new, ignore=shutil.ignore_patterns("captures"))
    plan, names = Session(old).read_plan(), list(load_venue(venue).table.projectors)
    camera = next(iter(load_venue(venue).cameras.values()))
    partner = {}
    for first, second in zip(
        *([s for s in plan.shots if s.projector == n and s.purpose != "dim"] for n in names),
        strict=True,
    ):
        partner |= {first.id: second, second.id: first}
    for shot in plan.shots:
        for exposure_s in shot.exposures_s:
            taken = Session(old).load(
                camera.name, partner.get(shot.id, shot), exposure_s, camera.size
            )
            Session(new).store(camera.name, shot, exposure_s, taken)
    return new


def test_a_calibration_that_contradicts_the_one_in_use_is_not_used(venue: Path) -> None:
    """Photographs that were exchanged solve as well as before: only the predecessor differs."""
    session = exchange_projectors(venue)
    ran = procam("session", "solve", session)
    assert ran.code == 0
    assert "note: 0002 contradicts 0001, which stays in use: " in ran.out
    assert "wrong projector on the wire. If the new one is right, run: procam venue use " in ran.out
    assert calibration_in_use(venue).name == "0001"
    assert "0002 is in use" in procam("venue", "use", f"{venue}@2").out
    assert calibration_in_use(venue).name == "0002"


def test_what_was_measured_since_the_last_solve_is_not_lost_without_a_word(venue: Path) -> None:
    old = load_calibration(venue / "calibrations" / "0001")
    metered = AbsoluteColour(np.diag([5.0, 9.0, 4.0]), np.eye(9))
    full = VenueState("full", old.feedback, np.ones(3))
    richer = replace(old, absolute=metered, states={"full": full})
    save_calibration(richer, venue / "calibrations" / "0002")
    out = procam("session", "solve", venue).out
    assert "note: venue states of 0002 are not in it: full; measure them again: procam state" in out
    assert "note: 0002 knew its white in cd/m2 by a hand meter, and this one does not" in out


def test_the_same_again_succeeds_without_a_word(twice: tuple[Path, Ran]) -> None:
    venue, ran = twice
    assert json.loads(ran.out)["notes"] == []
    assert calibration_in_use(venue).name == "0002"


class TestUse:
    def test_an_older_one_counts_until_a_later_one_is_made(
        self, twice: tuple[Path, Ran], tmp_path: Path
    ) -> None:
        venue = Path(shutil.copytree(twice[0], tmp_path / "venue"))
        with coarse_rooms(), quick_simulator():
            assert (
                f"{venue / 'calibrations' / '0001'} is in use"
                in procam("venue", "use", f"{venue}@1").out
            )
            assert calibration_in_use(venue).name == "0001"
            procam("state", venue, "full")  # adds a state to the one in use
        assert calibration_in_use(venue).name == "0003"
        assert "full" in load_calibration(calibration_in_use(venue)).states

    def test_a_choice_that_is_not_there_is_refused_until_another_is_made(self, venue: Path) -> None:
        chosen = venue / "calibrations" / "in-use"
        for text in (b"0007\n", b"\xff../../x", b""):
            chosen.write_bytes(text)
            complaint = refused("report", venue)
            assert f"{chosen} names calibration " in complaint
            assert f"choose one of them: procam venue use {venue}@N" in complaint
            listed = procam("venue", "status", venue)
            assert (listed.code, "which is not there, only 0001" in listed.out) == (0, True)
            assert json.loads(procam("venue", "status", venue, "--json").out)["in_use"] is None
        assert procam("venue", "use", f"{venue}@1").code == 0
        assert calibration_in_use(venue).name == "0001"

    def test_a_venue_stands_for_its_calibration(self, venue: Path, tmp_path: Path) -> None:
        sky = np.random.default_rng(0).random((64, 64, 3))
        write_image(tmp_path / "sky.png", (sky * 255).astype(np.uint8))
        for where, out in ((venue, "a.png"), (venue / "calibrations" / "0001", "b.png")):
            assert procam("compensate", where, tmp_path / "sky.png", tmp_path / out).code == 0
        assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
