"""Photographs whose light does not add up are refused by cause, or noted."""

import re
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import make_venue, take_session

from procam.errors import OutOfModelRange
from procam.estimate.camera.radiance import Radiometer
from procam.estimate.light.separation import Separation
from procam.estimate.light.stability import StabilityChecks
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.generators import result_of
from procam.model.calibration import Calibration
from procam.model.frame import Frame
from procam.model.plan import Shot
from procam.workflows.capture.session_images import SessionImages
from procam.workflows.solve.calibrate import solve

Captured = tuple[Venue, Session]


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Captured:
    venue = make_venue(tmp_path_factory.mktemp("venue"))
    return venue, take_session(venue)


def solved(captured: Captured) -> Path:
    return result_of(solve(*captured)).directory


@pytest.fixture(scope="module")
def sound(captured: Captured) -> Calibration:
    """What is found with nothing wrong."""
    return load_calibration(solved(captured))


def test_a_tone_curve_that_venue_toml_does_not_know(
    captured: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    linear = Radiometer.radiance

    def encoded(self: Radiometer, frame: Frame) -> np.ndarray:
        light = linear(self, frame)
        return np.asarray(np.sign(light) * np.abs(light) ** (1 / 2.2), np.float32)

    monkeypatch.setattr(Radiometer, "radiance", encoded)
    with pytest.raises(OutOfModelRange, match=r"0\.4\d .+ photograph raw"):
        solved(captured)


def test_stripes_out_of_focus(captured: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Separation, "_edge_blur", lambda *_: 3.2)
    wanted = r"south: edges of its stripes are blurred by 3\.2 pixels .+ more than 2\.5; focus the"
    with pytest.raises(OutOfModelRange, match=wanted):
        solved(captured)


def changing(monkeypatch: pytest.MonkeyPatch, share: float, drift: float = 0.0) -> None:
    """Light of the room, or a lamp, changes after the codes: in stripes but not in white."""
    steady = SessionImages.light

    def light(self: SessionImages, shot: Shot, exposure: int = 0) -> np.ndarray:
        seen = steady(self, shot, exposure)
        if shot.purpose != "stripes":
            return seen
        return np.asarray(seen * (1 + drift) + share * np.nanpercentile(seen, 95), np.float32)

    monkeypatch.setattr(SessionImages, "light", light)


def test_a_door_that_opened(captured: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    changing(monkeypatch, 0.02)
    with pytest.raises(OutOfModelRange, match=r"light of the room changed .+ photograph it again"):
        solved(captured)


def test_less_of_it_is_noted(captured: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    changing(monkeypatch, 0.0, drift=0.012)
    notes = load_calibration(solved(captured)).provenance.note_lines
    assert [n for n in notes if "drifted while it was photographed" in n and "+1.1" in n]


def test_steady_light_is_not_noted(sound: Calibration) -> None:
    assert not sound.provenance.note_lines


def test_what_a_missing_dim_picture_would_tell(
    captured: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SessionImages, "dim", lambda _: None)
    (note,) = load_calibration(solved(captured)).provenance.note_lines
    assert "the dim picture at the end, was not photographed" in note


def test_a_long_exposure_that_is_shorter_is_measured(
    captured: Captured, sound: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    steady = Radiometer.radiance

    def shorter(self: Radiometer, frame: Frame) -> np.ndarray:
        light = steady(self, frame)
        return light * np.float32(0.8) if frame.settings.exposure_s > 1 else light

    monkeypatch.setattr(Radiometer, "radiance", shorter)
    found = load_calibration(solved(captured))
    (note,) = found.provenance.note_lines
    assert re.search(r"photographs of 6\.5 s were exposed 0\.(79|80?)", note), note
    lit = sound.maps.coverage > 0.999
    assert found.maps.lo[lit].mean() == pytest.approx(sound.maps.lo[lit].mean(), rel=0.02)


def test_counts_with_gaps_are_not_taken_for_those_of_a_jpeg(
    captured: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a camera writes whose bits are the upper ones of its files'."""
    steady, counts = Radiometer.radiance, SessionImages.counts

    def shorter(self: Radiometer, frame: Frame) -> np.ndarray:
        light = steady(self, frame)
        return light * np.float32(0.95) if frame.settings.exposure_s > 1 else light

    def upper(self: SessionImages, shot: Shot, exposure: int = 0) -> np.ndarray:
        seen = counts(self, shot, exposure)
        return 2 * (seen // 2) if shot.purpose == "dim" else seen

    monkeypatch.setattr(Radiometer, "radiance", shorter)
    monkeypatch.setattr(SessionImages, "counts", upper)
    (note,) = load_calibration(solved(captured)).provenance.note_lines
    assert re.search(r"photographs of 6\.5 s were exposed 0\.9[45]", note), note


def test_a_photograph_of_the_code_that_was_exposed_longer(
    captured: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    steady = SessionImages.counts

    def counts(self: SessionImages, shot: Shot, exposure: int = 0) -> np.ndarray:
        seen = steady(self, shot, exposure)
        longer = shot.detail.get("plane") == 5
        level = self.radiometer.camera.sensor.black_level
        return (level + 1.3 * (seen - level)).astype(np.uint16) if longer else seen

    monkeypatch.setattr(SessionImages, "counts", counts)
    notes = load_calibration(solved(captured)).provenance.note_lines
    odd = r"projector south: photographs of its waves .*: south-0005 \(1\.(29|3\d) times\)\."
    assert [note for note in notes if re.match(odd, note)], notes


@pytest.mark.parametrize(("exposure", "ratio"), [(0, 1.5), (1, 1 / 1.5)])
def test_a_photograph_of_black_that_was_exposed_longer(
    captured: Captured, monkeypatch: pytest.MonkeyPatch, exposure: int, ratio: float
) -> None:
    steady = SessionImages.light

    def light(self: SessionImages, shot: Shot, number: int = 0) -> np.ndarray:
        longer = shot.purpose == "black" and number == exposure
        return steady(self, shot, number) * np.float32(1.5 if longer else 1)

    monkeypatch.setattr(SessionImages, "light", light)
    (note,) = load_calibration(solved(captured)).provenance.note_lines
    found = re.search(r"south: its black is (\S+) times as bright at 6\.5 s as at 0\.13 s", note)
    assert found and float(found[1]) == pytest.approx(ratio, rel=0.1), note


def test_a_camera_that_moved_widens_the_figures_of_directions(
    captured: Captured, sound: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("direction_sigma_relative_arcmin", "direction_sigma_arcmin")
    monkeypatch.setattr(StabilityChecks, "shift_px", 0.5)
    found = load_calibration(solved(captured))
    focal_px = np.mean(next(iter(found.cameras.values())).lens.focal)
    for name in names:
        wider = np.hypot(sound.quality[name].value, 60 * np.degrees(0.5 / focal_px))
        assert found.quality[name].value == pytest.approx(wider, rel=1e-3)
