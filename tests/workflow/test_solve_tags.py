"""A venue whose only fiducials are AprilTags on the dome, from its pictures to a calibration."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from printed_tags import Printed, whiteness
from tiny_venue import CAMERA, TINY_PAIR, make_venue, take_session

from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import Venue, load_venue
from procam.generators import result_of
from procam.maths.geometry.pose import rotation_vector
from procam.model.calibration import Calibration
from procam.model.plan import Plan, Shot
from procam.workflows.solve.apriltags import tag_notes
from procam.workflows.solve.calibrate import solve
from simulators.placement import place_cameras

SIZE = replace(TINY_PAIR, camera_size=(480, 480))
EDGE_M, RADIUS_M = 1.2, 6.0
PLACES_DEG = {3: (12.0, 35.0), 4: (130.0, 30.0), 5: (-110.0, 50.0)}
LOST = 11
FIDUCIALS = re.compile(r"\[\[fiducials\]\]\n(?:\w.*\n)+")


@dataclass(frozen=True)
class Solved:
    venue: Venue
    calibration: Calibration

    @property
    def texts(self) -> list[str]:
        """The notes of the calibration."""
        return self.calibration.provenance.note_lines


def stick_tags(session: Session) -> None:
    """Draw tags into the pictures of white, as if they were on the dome."""
    (build,) = place_cameras(1, SIZE.camera_size, "fisheye")
    tags = [Printed(n, *np.radians(place), EDGE_M) for n, place in PLACES_DEG.items()]
    pose = build.camera_from_dome
    white = whiteness(tags, build.lens, build.size, pose, RADIUS_M)[..., None]
    for shot in session.read_plan().shots:
        if shot.purpose == "white":
            frame = session.load(CAMERA, shot, shot.exposures_s[0], build.size)
            light = (frame.counts - build.black_level) * white + build.black_level
            counts = np.clip(np.rint(light), 0, 4095).astype(np.uint16)
            session.store(CAMERA, shot, shot.exposures_s[0], replace(frame, counts=counts))


def list_tags(venue: Venue) -> Venue:
    """The venue with tags instead of fiducials; one of them is not on the dome."""
    path = venue.directory / "venue.toml"
    entries = [
        f"[[apriltags]]\nid = {n}\nazimuth_deg = {azimuth}\nelevation_deg = {elevation}\n"
        "sigma_deg = 0.01\n\n"
        for n, (azimuth, elevation) in (PLACES_DEG | {LOST: (0.0, 60.0)}).items()
    ]
    distance = f'[[distances]]\na = "{CAMERA}"\nb = "tag {LOST}"\nmetres = 5.0\n\n'
    text = FIDUCIALS.sub("", path.read_text("utf-8"))
    path.write_text(text.replace("[capture]", "".join(entries) + distance + "[capture]"), "utf-8")
    return load_venue(venue.directory)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Solved]:
    venue = make_venue(tmp_path_factory.mktemp("tags"), size=SIZE)
    session = take_session(venue)
    stick_tags(session)
    venue = list_tags(venue)
    yield Solved(venue, load_calibration(result_of(solve(venue, session)).directory))


def test_the_rig_is_rotated_to_the_tags(run: Solved) -> None:
    calibration = run.calibration
    (build,) = place_cameras(1, SIZE.camera_size, "fisheye")
    found = calibration.cameras[CAMERA].camera_from_dome
    assert found is not None
    turn = rotation_vector(found.rotation @ build.camera_from_dome.rotation.T)
    assert np.degrees(np.linalg.norm(turn)) < 0.05
    assert not any("front and pole" in text for text in run.texts)


def test_a_missing_tag_and_its_distance_are_in_the_notes(run: Solved) -> None:
    lines = [text for text in run.texts if f"tag {LOST}" in text]
    assert str(lines[0]).startswith(f"tag {LOST}: no camera sees it; ")
    assert lines[1:] == [f"the distance from {CAMERA} to tag {LOST} is left out"]


def test_shot_marks_are_not_fiducials(run: Solved) -> None:
    white = Shot("s-0000", "south", "", "white", (0.1,), detail={"number": 3})
    code = Shot("s-0002", "south", "", "code", (0.1,), detail={"number": 4})
    lines = tag_notes(run.venue, Plan((white, code)), {})
    assert str(lines[0]).startswith("tag 3: the pictures of this session carry that number")
    assert str(lines[1]).startswith("tag 4, tag 5, tag 11: no camera")
