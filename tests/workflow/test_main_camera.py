"""What a person has masked is left out wherever a calibration's main camera looks."""

import numpy as np
import pytest
from tiny_venue import make_venue, solved, take_session

from procam.files.calibration import load_calibration
from procam.files.venue.load import Venue, load_venue
from procam.model.calibration import Calibration
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import DrivenPhotographer
from procam.workflows.refine.camera import LoopCamera
from procam.workflows.venue_rig import open_rig
from procam.workflows.verify.photographs import read_reference

PILLAR = "masks = [[[80, 40], [120, 40], [120, 90], [80, 90]]]\n"
DOOR = "masks = [[[-20, 20], [20, 20], [20, 50], [-20, 50]]]\n"


@pytest.fixture(scope="module")
def masked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Venue, Calibration]:
    venue = make_venue(tmp_path_factory.mktemp("dome"))
    made = solved(venue, take_session(venue))
    file = venue.directory / "venue.toml"
    text = file.read_text("utf-8").replace("[cameras.zenith]\n", "[cameras.zenith]\n" + PILLAR)
    file.write_text(text.replace("[screen]\n", "[screen]\n" + DOOR), "utf-8")
    return load_venue(venue.directory), load_calibration(made)


def test_masks_of_camera_and_screen(masked: tuple[Venue, Calibration]) -> None:
    venue, calibration = masked
    camera, plain = MainCamera.of(venue, calibration), _without_masks(venue)
    whole = MainCamera.of(plain, calibration).view.on_screen
    seen = camera.view.on_screen
    assert whole[60, 100] and not seen[40:90, 80:120].any()
    elevation = np.degrees(np.arcsin(np.clip(camera.view.direction[..., 2], -1, 1)))
    azimuth = np.degrees(np.arctan2(camera.view.direction[..., 1], camera.view.direction[..., 0]))
    door = (np.abs(azimuth) < 15) & (np.abs(elevation - 35) < 10)
    assert (whole & door).any() and not (seen & door).any()


def _without_masks(venue: Venue) -> Venue:
    file = venue.directory / "plain" / "venue.toml"
    file.parent.mkdir()
    text = (venue.directory / "venue.toml").read_text("utf-8")
    file.write_text(text.replace(PILLAR, "").replace(DOOR, ""), "utf-8")
    return load_venue(file.parent)


def test_verify_and_refine_leave_out_the_same(masked: tuple[Venue, Calibration]) -> None:
    venue, calibration = masked
    seen = MainCamera.of(venue, calibration).view.on_screen
    reference = read_reference(venue, calibration)
    assert np.array_equal(reference.photographs.view.on_screen, seen)
    with open_rig(venue) as rig:
        loop = LoopCamera(DrivenPhotographer(rig, calibration), MainCamera.of(venue, calibration))
    assert not loop.cells.use[~seen].any()
