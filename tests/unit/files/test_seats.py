"""Which calibrations of a venue are independent of another one: other seats, other photographs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from two_seats import DARK, HERE, THERE, WHITE, keep, photograph, seen_from

from procam.files.seats import OtherSeat, other_seats
from procam.maths.geometry.pose import Pose, rotation_matrix
from procam.model.calibration import Calibration

RADIUS_M = 6.0


@pytest.fixture
def used(tmp_path: Path, calibration: Calibration) -> Path:
    """A venue's first calibration, of session 0001."""
    return keep(tmp_path, seen_from(calibration, HERE), "0001")


def _found(used: Path) -> list[OtherSeat]:
    return list(other_seats(used.parents[1], used))


def _names(used: Path) -> list[str]:
    return [seat.directory.name for seat in _found(used)]


def _in_frame(calibration: Calibration, turn: np.ndarray, scale: float = 1.0) -> Calibration:
    """The calibration in a rotated frame and another unit of length."""

    def moved(pose: Pose) -> Pose:
        return Pose(pose.rotation @ turn.T, scale * pose.translation)

    cameras = {
        n: replace(c, camera_from_dome=moved(c.camera_from_dome))  # type: ignore[arg-type]
        for n, c in calibration.cameras.items()
    }
    projectors = {
        n: replace(
            p, model=replace(p.model, projector_from_dome=moved(p.model.projector_from_dome))
        )
        for n, p in calibration.projectors.items()
    }
    screen = replace(calibration.screen, radius_m=scale * calibration.screen.radius_m)
    return replace(calibration, cameras=cameras, projectors=projectors, screen=screen)


class TestSeats:
    def test_the_newest_is_first(self, used: Path, calibration: Calibration) -> None:
        venue = used.parents[1]
        assert _found(used) == []
        keep(venue, seen_from(calibration, THERE, turn_deg=30), "0002")
        keep(venue, seen_from(calibration, (0.1, 1.4, -0.5)), "0003")
        newest, second = _found(used)
        assert (newest.directory.name, second.directory.name) == ("0003", "0002")
        assert (second.camera, second.here) == ("zenith", "zenith")
        assert second.distance_m == pytest.approx(2.0) and second.turn_deg == pytest.approx(30)
        assert second.share == pytest.approx(2.0 / RADIUS_M)

    @pytest.mark.parametrize(("beyond", "found"), [(0.98, []), (1.02, ["0002"])])
    def test_a_seat_is_a_twentieth_of_the_radius_away(
        self, used: Path, calibration: Calibration, beyond: float, found: list[str]
    ) -> None:
        x, y, z = HERE
        place = (x, y + beyond * 0.05 * RADIUS_M, z)
        keep(used.parents[1], seen_from(calibration, place), "0002")
        assert _names(used) == found

    def test_another_frame_is_not_another_seat(self, used: Path, calibration: Calibration) -> None:
        turn = rotation_matrix([0.3, -0.2, 2.0])
        keep(used.parents[1], _in_frame(seen_from(calibration, HERE), turn), "0002")
        assert _found(used) == []
        keep(used.parents[1], _in_frame(seen_from(calibration, THERE, 30), turn, 0.5), "0003")
        (seat,) = _found(used)
        assert seat.distance_m == pytest.approx(2.0) and seat.turn_deg == pytest.approx(30)

    def test_no_camera_may_stand_where_one_stood(
        self, used: Path, calibration: Calibration
    ) -> None:
        away, same = (seen_from(calibration, place).cameras["zenith"] for place in (THERE, HERE))
        both = replace(calibration, cameras={"far": away, "zenith": same})
        keep(used.parents[1], both, "0002")
        assert _found(used) == []
        keep(
            used.parents[1], replace(calibration, cameras={"far": away}, main_camera="far"), "0003"
        )
        assert [(seat.camera, seat.here) for seat in _found(used)] == [("far", "zenith")]

    def test_it_is_of_the_same_projectors(self, used: Path, calibration: Calibration) -> None:
        venue, there = used.parents[1], seen_from(calibration, THERE)
        south = calibration.projectors["south"]
        keep(venue, replace(there, projectors={"south": south}), "0002")
        keep(venue, replace(there, projectors={"south": south, "east": south}), "0003")
        assert _found(used) == []

    def test_a_damaged_one_is_passed_over(self, used: Path, calibration: Calibration) -> None:
        other = keep(used.parents[1], seen_from(calibration, THERE), "0002")
        (other / "calibration.json").write_text('{"provenance": []}')
        assert _found(used) == []
        for missing in ("cameras", "projectors"):
            document = json.loads((used / "calibration.json").read_text()) | {missing: {}}
            (other / "calibration.json").write_text(json.dumps(document))
            assert _found(used) == []
        keep(used.parents[1], seen_from(calibration, THERE), "../0003")
        assert _found(used) == []
        (used / "calibration.json").write_text("no JSON")
        assert _found(used) == []


class TestPhotographs:
    @pytest.fixture
    def venue(self, used: Path, calibration: Calibration) -> Path:
        """With a calibration 0002 from another seat, of session 0002."""
        keep(used.parents[1], seen_from(calibration, THERE), "0002")
        return used.parents[1]

    def test_one_in_both_sessions_is_enough(self, used: Path, venue: Path) -> None:
        photograph(venue, "0001", {DARK: "a", WHITE: "b"})
        photograph(venue, "0002", {DARK: "c", WHITE: "b"})  # a link
        assert _names(used) == []

    def test_the_dark_may_look_alike(self, used: Path, venue: Path) -> None:
        photograph(venue, "0001", {DARK: "a", WHITE: "b"})
        photograph(venue, "0002", {DARK: "a", WHITE: "c"})
        assert _names(used) == ["0002"]

    def test_two_cameras_of_one_session_share_none(
        self, used: Path, venue: Path, calibration: Calibration
    ) -> None:
        away = seen_from(calibration, THERE).cameras["zenith"]
        photograph(venue, "0001", {WHITE: "b"})
        index = venue / "sessions/0001/captures/far/index.jsonl"
        index.parent.mkdir()
        own = (index.parents[1] / "zenith" / "index.jsonl").read_text()
        index.write_text(own.replace('"b"', '"c"'))
        keep(venue, replace(calibration, cameras={"far": away}, main_camera="far"), "0001")
        assert _names(used) == ["0003", "0002"]
        index.write_text(own)
        assert _names(used) == ["0002"]

    def test_the_same_session_solved_with_another_lens(
        self, used: Path, venue: Path, calibration: Calibration
    ) -> None:
        """A wrong focal length moves the camera, but the photographs are the same."""
        keep(venue, seen_from(calibration, THERE), "0001")
        assert _names(used) == ["0002"]  # also where the session's index is gone
        photograph(venue, "0001", {WHITE: "b"})
        assert _names(used) == ["0002"]

    def test_a_recalibrated_one_needs_its_index(
        self, used: Path, venue: Path, calibration: Calibration
    ) -> None:
        keep(venue, seen_from(calibration, THERE), "0003", recalibrated=["north"])
        assert _names(used) == ["0002"]
        photograph(venue, "0001", {WHITE: "b"})
        photograph(venue, "0003", {WHITE: "c"})
        assert _names(used) == ["0003", "0002"]
