"""A venue stored by version 0.1.0, before modules and classes were renamed, still loads and solves."""

import json
import tarfile
from pathlib import Path

import numpy as np
import pytest
from edited_files import rewrite

from procam.compensate.compensator import Compensator
from procam.estimate.light import separation
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.workflows.solve.calibrate import solve

STORED = Path(__file__).parents[1] / "data" / "venue-format-1.tar.xz"


@pytest.fixture(scope="module")
def venue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stored")
    with tarfile.open(STORED) as archive:
        archive.extractall(folder, filter="data")
    rewrite(folder / "venue.toml", "[screen]", "[screen]\nmap_size = 64")  # as it was then
    return folder


def test_a_calibration_loads_with_its_venue_state(venue: Path) -> None:
    folder = venue / "calibrations" / "0002"
    stored = json.loads((folder / "calibration.json").read_text("utf-8"))
    calibration = load_calibration(folder)
    np.testing.assert_array_equal(calibration.feedback.value, stored["feedback"]["value"])
    state = calibration.states["full"]
    np.testing.assert_array_equal(
        state.feedback.value, stored["states"]["full"]["feedback"]["value"]
    )
    grey = np.full((64, 64, 3), 0.3, np.float32)
    empty, full = (Compensator(calibration, 64, state=name).frame(grey) for name in (None, "full"))
    assert 0 < empty.max() <= 1
    assert not np.array_equal(empty, full)


def test_a_session_solves_to_the_calibration_stored_then(
    venue: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(separation, "CLEAR_SIGMAS", 0.0)  # blur was not measured then
    found = result_of(solve(load_venue(venue), Session(venue / "sessions" / "0001")))
    stored, again = (load_calibration(venue / "calibrations" / n) for n in ("0002", "0003"))
    assert found.directory.name == "0003"
    assert again.maps.size == stored.maps.size == 64
    # scattered light was divided by a kernel's gain then, and pixels on the picture's border were decoded
    assert (abs(again.feedback.value - stored.feedback.value) < stored.feedback.sigma / 4).all()
    # the floor was in the rim's plane for certain then, and no wall returned light
    assert (abs(again.albedo.value - stored.albedo.value) < stored.albedo.sigma / 2).all()
    surface, before = again.projectors["south"].surface, stored.projectors["south"].surface
    # the third radial term of the projector's lens was 0 then; it moves the corners of the panel
    both = surface.valid & before.valid & (surface.measured > 0.5)
    assert both.sum() > 0.999 * before.valid.sum()
    # standard errors of decoded pixels did not include paint then, and pixels were not square
    off = np.linalg.norm(surface.direction - before.direction, axis=-1)[both]
    assert np.mean(np.degrees(off) * 60 < before.sigma_arcmin[both] / 2) > 0.95
