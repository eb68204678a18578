"""A venue whose camera has 8 bits: dim parts of a picture are decoded, or refused by name."""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from tiny_venue import TINY, make_venue, solved, take_session

from procam.errors import CalibrationError
from procam.estimate.camera.radiance import Radiometer
from procam.files.calibration import load_calibration
from procam.files.venue.load import load_venue
from procam.model.calibration import Calibration
from procam.model.frame import Frame
from procam.model.plan import Shot
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve import direct_light, rig
from procam.workflows.solve.decode import decode_projector
from simulators.truth import write_truth

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
    """The venue with 8 bits, its session, m and albedo by 12 bits, and the simulator's."""
    venue = make_venue(tmp_path_factory.mktemp("venue"), size=TINY)
    session = take_session(venue)
    finest = load_calibration(solved(venue, session))
    write_truth(venue.backends["simulated"], venue.directory, venue.directory / "truth", {})
    truth = load_calibration(venue.directory / "truth")
    path = venue.directory / "venue.toml"
    text = re.sub(r"bits = \d+", "bits = 8", path.read_text())
    path.write_text(re.sub(r"black_level = \S+", f"black_level = {EIGHT_BLACK}", text))
    yield load_venue(venue.directory), session, finest, truth


def images(taken: tuple, kind: type[SessionImages]) -> SessionImages:
    venue, session, *_ = taken
    return kind(session, session.read_plan(), Radiometer(venue.cameras["zenith"]))


def test_the_noise_is_the_cameras(taken: tuple) -> None:
    shots = images(taken, EightBits)
    law, _ = direct_light.stripe_light(shots, "south", *shots.white_and_black("south"))
    assert 0.08 < law.floor < 0.3 and 0 <= law.per_level < 0.1


def test_a_dim_picture_is_decoded(taken: tuple) -> None:
    clear, dim = (
        decode_projector(taken[0], images(taken, kind), "south")[0].valid
        for kind in (EightBits, Dim)
    )
    white, black = images(taken, Dim).white_and_black("south")
    assert np.percentile((white - black.astype(float))[clear], 50) < 18
    assert dim[clear].mean() > 0.9


def assert_covers(found: Calibration, truth: Calibration) -> None:
    pairs = (found.feedback, truth.feedback), (found.albedo, truth.albedo)
    for ours, theirs in pairs:
        assert (abs(ours.value / theirs.value - 1) < 0.05).all()
        assert (abs(ours.value - theirs.value) < 2 * ours.sigma).all()


def test_twelve_bits_light_what_is_lit_and_no_more(taken: tuple) -> None:
    *_, found, truth = taken
    assert not [
        note for note in found.provenance.note_lines if "waves" in note or "sharpens" in note
    ]
    assert_covers(found, truth)
    covered = [float(calibration.maps.coverage.mean()) for calibration in (found, truth)]
    assert covered[0] == pytest.approx(covered[1], rel=0.01)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_feedback_and_albedo_are_the_simulators(
    taken: tuple, monkeypatch: pytest.MonkeyPatch, gain: float
) -> None:
    venue, session, _, truth = taken
    monkeypatch.setattr(EightBits, "gain", gain)
    monkeypatch.setattr(rig, "SessionImages", EightBits)
    found = load_calibration(solved(venue, session))
    assert_covers(found, truth)


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


class CutOff(SessionImages):
    """Photographs of a camera that cuts its noise off at black, as one that encodes does."""

    def _frame(self, shot: Shot, exposure: int) -> Frame:
        frame = super()._frame(shot, exposure)
        return replace(frame, counts=frame.counts.clip(int(BLACK)) - np.uint16(BLACK))


def test_room_light_is_not_the_mean_of_noise_that_is_cut_off(taken: tuple) -> None:
    shots = images(taken, SessionImages)
    camera = shots.radiometer.camera
    camera = replace(camera, sensor=replace(camera.sensor, bits=12, black_level=BLACK))
    whole = replace(shots, radiometer=Radiometer(camera))
    sensor = replace(camera.sensor, black_level=0.0)
    cut_off = images(taken, CutOff)
    cut_off = replace(cut_off, radiometer=Radiometer(replace(camera, sensor=sensor)))
    seen = whole.radiometer.seen
    short, long = (light[seen].mean() * sensor.full_scale for light in whole.dark())
    assert abs(short - long) < 0.2
    short, long = (light[seen].mean() * sensor.full_scale for light in cut_off.dark())
    assert short == long
