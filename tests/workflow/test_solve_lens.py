"""Light is measured through the lens that was solved, not the one that venue.toml starts from."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from edited_files import rewritten
from tiny_venue import TINY_PAIR, make_venue, solved, take_session

from procam.errors import CalibrationError
from procam.estimate.camera.veil import NearVeilFit
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import Venue, load_venue
from procam.model.calibration import Calibration
from procam.workflows.solve.geometry import _lens_notes
from simulators.placement import place_cameras
from simulators.presets import PRESETS

SIZE = replace(TINY_PAIR, camera_size=(256, 256))
TOO_LONG = 1.01  # focal length of venue.toml over the true one
PULL = 1e-3  # of m, by a focal length that is 1 % off: the lens moves by 0.7 %, m by 0.02 %


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Venue, Session]:
    venue = make_venue(tmp_path_factory.mktemp("lens") / "venue", size=SIZE)
    return venue, take_session(venue)


def _with_lens(captured: tuple[Venue, Session], mode: str, factor: float) -> Calibration:
    """The calibration of the session with a focal length off by a factor."""
    venue, session = captured
    path = venue.directory / "venue.toml"
    focal = [factor * float(f) for f in venue.cameras["zenith"].lens.focal]
    with (
        rewritten(path, r"^f = \[.*?\]", f"f = {focal}"),
        rewritten(path, '^intrinsics = "prior"', f'intrinsics = "{mode}"'),
    ):
        return load_calibration(solved(load_venue(venue.directory), session))


def test_feedback_and_albedo_do_not_follow_a_wrong_prior(
    captured: tuple[Venue, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    # whether a veil is significant in so small a picture is chance, and moves m by one of its sigmas
    monkeypatch.setattr(NearVeilFit, "result", lambda fit: [])
    owner = captured[0].cameras["zenith"].lens.focal[0]
    (camera,) = place_cameras(1, SIZE.camera_size, SIZE.camera_kind, PRESETS["standard"])
    right = _with_lens(captured, "fixed", float(camera.lens.focal[0] / owner))
    assert not _beyond_the_rim(right)
    for mode in ("prior", "solve"):
        wrong = _with_lens(captured, mode, TOO_LONG)
        np.testing.assert_allclose(wrong.feedback.value, right.feedback.value, rtol=PULL)
        moved = np.abs(wrong.albedo.value - right.albedo.value)
        assert (moved < 0.1 * right.albedo.sigma).all()  # by what the floor seems to be
        assert not _focal_notes(wrong)  # twice its sigma is no surprise


@pytest.mark.parametrize("mode", ["fixed", "solve"])
def test_a_wrong_mark_is_named_whatever_the_lens(
    captured: tuple[Venue, Session], mode: str
) -> None:
    """A lens that is solved for must not bend to fit it."""
    path = captured[0].directory / "venue.toml"
    with (
        rewritten(path, r"^azimuth_deg = 12\..*$", "azimuth_deg = 18.0"),
        pytest.raises(CalibrationError, match=r"fiducials: front.*(is wrong|does not fit)"),
    ):
        _with_lens(captured, mode, 1.0)


def test_exchanged_marks_that_turn_the_dome_over_are_refused(
    captured: tuple[Venue, Session],
) -> None:
    """Two marks alone fit as well with mirrored azimuths as with the right ones."""
    path = captured[0].directory / "venue.toml"
    kept = path.read_text()
    head, *marks = re.split(r"(?=\[\[fiducials\]\])", kept)
    last, tail = marks[2][: marks[2].index("[capture]")], marks[2][marks[2].index("[capture]") :]
    assert last
    mirrored = "".join(marks[:2]).replace("azimuth_deg = ", "azimuth_deg = -")
    path.write_text(head + mirrored + tail)
    try:
        with pytest.raises(CalibrationError, match=r"would lie beyond the dome's rim\. Check"):
            _with_lens(captured, "fixed", 1.0)
    finally:
        path.write_text(kept)


def test_a_picture_beyond_the_rim_is_noted(captured: tuple[Venue, Session]) -> None:
    path = captured[0].directory / "venue.toml"
    with rewritten(path, r"^half_angle_deg = \S+", "half_angle_deg = 82"):
        assert _beyond_the_rim(_with_lens(captured, "fixed", 1.0))


def _beyond_the_rim(calibration: Calibration) -> bool:
    return any("lie beyond the dome's rim" in note for note in calibration.provenance.note_lines)


def _solved_with(share: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """A problem with one camera of a prior lens, and a solution that has another focal length."""
    camera = SimpleNamespace(lens=SimpleNamespace(focal=np.full(2, 100.0)))
    other = SimpleNamespace(lens=SimpleNamespace(focal=np.full(2, 100.0 * (1 + share))))
    problem = SimpleNamespace(cameras={"zenith": camera}, intrinsics={"zenith": "prior"})
    return problem, SimpleNamespace(rig=SimpleNamespace(cameras={"zenith": other}))


def test_a_focal_length_beyond_its_prior_is_named() -> None:
    (found,) = _lens_notes(*_solved_with(-0.03))
    assert str(found).startswith("camera zenith: its pictures need a focal length -3.0% from f")
    assert str(found).endswith('or correct f, or set intrinsics = "solve", as "prior" means 0.5%')
    assert not _lens_notes(*_solved_with(0.009))


@pytest.mark.parametrize("share", [-0.05, 0.04])
def test_pictures_cropped_by_a_stabiliser_are_refused(share: float) -> None:
    """The lens of venue.toml is not that of the photographs, so its prior would bend directions."""
    with pytest.raises(CalibrationError, match=r"camera zenith: .+ cropped or scaled since"):
        _lens_notes(*_solved_with(share))


def _focal_notes(calibration: Calibration) -> list[str]:
    notes: list[str] = calibration.provenance.note_lines
    return [note for note in notes if "its pictures need a focal length" in note]
