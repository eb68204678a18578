"""A venue whose camera has 8 bits: dim parts of a picture are decoded, or refused by name."""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tiny_venue import TINY, make_venue, quick_simulator, solved, take_session

from procam.errors import CalibrationError
from procam.estimate.camera.radiance import Radiometer
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.model.frame import Frame
from procam.model.plan import Shot
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve import calibrate, direct_light

BLACK, EIGHT_BLACK = 64.0, 4.0
DIM = 0.12  # of the exposure: white reaches some 25 of 255


class EightBits(SessionImages):
    """The photographs of a camera of 12 bits as one of 8 bits takes them."""

    gain = 1.0

    def _frame(self, shot: Shot, exposure: int) -> Frame:
        frame = super()._frame(shot, exposure)
        light = self.gain * (frame.counts - BLACK) / (4095 - BLACK)
        counts = np.rint(EIGHT_BLACK + light * (255 - EIGHT_BLACK)).clip(0, 255)
        return replace(frame, counts=counts.astype(np.uint16))


class Dim(EightBits):
    """The same, exposed much too short."""

    gain = DIM


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple]:
    """The venue with 8 bits, its session, and m and albedo by 12 bits."""
    with quick_simulator():
        venue = make_venue(tmp_path_factory.mktemp("venue"), size=TINY)
        session = take_session(venue)
        finest = load_calibration(solved(venue, session))
        assert not [note for note in finest.provenance["notes"] if "sharpens" in note]
        path = venue.directory / "venue.toml"
        text = re.sub(r"bits = \d+", "bits = 8", path.read_text())
        path.write_text(re.sub(r"black_level = \S+", f"black_level = {EIGHT_BLACK}", text))
        yield load_venue(venue.directory), session, finest


def images(taken: tuple, kind: type[SessionImages]) -> SessionImages:
    venue, session, _ = taken
    return kind(session, session.read_plan(), Radiometer(venue.cameras["zenith"]))


def test_the_noise_is_the_cameras(taken: tuple) -> None:
    law = direct_light.camera_noise(images(taken, EightBits), "south")
    assert 0.08 < law.floor < 0.3 and 0 <= law.per_level < 0.1


def test_a_dim_picture_is_decoded(taken: tuple) -> None:
    clear, dim = (
        calibrate.decode_projector(taken[0], images(taken, kind), "south")[0].valid
        for kind in (EightBits, Dim)
    )
    white, black = images(taken, Dim).white_and_black("south")
    assert np.percentile((white - black.astype(float))[clear], 50) < 18
    assert dim[clear].mean() > 0.9


def test_feedback_and_albedo_are_those_of_twelve_bits(
    taken: tuple, monkeypatch: pytest.MonkeyPatch
) -> None:
    venue, session, finest = taken
    monkeypatch.setattr(calibrate, "SessionImages", EightBits)
    found = load_calibration(solved(venue, session))
    for ours, theirs in ((found.feedback, finest.feedback), (found.albedo, finest.albedo)):
        np.testing.assert_allclose(ours.value, theirs.value, rtol=0.05)


def test_a_projector_that_is_hardly_decoded_is_refused_by_name(taken: tuple) -> None:
    shots, lit = images(taken, EightBits), np.zeros((200, 200), bool)
    lit[50:150, 50:150] = True
    decoded = lit.copy()
    decoded[50:150, 80:150] = False
    refused = r"projector south .* camera zenith sees, but only 30% of that"
    with pytest.raises(CalibrationError, match=refused):
        direct_light.check_decoded(shots, "south", decoded, lit)
    decoded[50:150, 50:120] = True
    direct_light.check_decoded(shots, "south", decoded, lit)
