"""What a person has masked is left out wherever a calibration's main camera looks."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_venue import make_venue, quick_simulator, solved, take_session

from procam.devices.protocols import Camera
from procam.errors import DeviceError
from procam.files.calibration import load_calibration
from procam.files.venue.load import Venue, load_venue
from procam.model.calibration import Calibration
from procam.model.frame import CameraSettings
from procam.workflows.main_camera import MainCamera
from procam.workflows.photographs.driven import DrivenPhotographer, Wanted
from procam.workflows.refine.camera import LoopCamera
from procam.workflows.venue_rig import open_rig
from procam.workflows.verify.photographs import read_reference

PILLAR = "masks = [[[80, 40], [120, 40], [120, 90], [80, 90]]]\n"
DOOR = "masks = [[[-20, 20], [20, 20], [20, 50], [-20, 50]]]\n"


@pytest.fixture(scope="module")
def masked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Venue, Calibration]:
    with quick_simulator():
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


class OnAuto:
    """A camera that answers another gain than it is asked for."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self.name, self.size = camera, camera.name, camera.size
        self.capture = camera.capture

    def configure(self, settings: CameraSettings) -> CameraSettings:
        return replace(self._camera.configure(settings), gain=2.0)


def test_a_camera_on_auto_is_refused_after_a_capture_too(
    masked: tuple[Venue, Calibration],
) -> None:
    venue, calibration = masked
    with open_rig(venue) as rig:
        on_auto = replace(rig, cameras={n: OnAuto(c) for n, c in rig.cameras.items()})
        photographer = DrivenPhotographer(on_auto, calibration)
        with pytest.raises(DeviceError, match="camera zenith: its gain is 2 and must stay 1"):
            photographer.take(Wanted({}, 0.1))
