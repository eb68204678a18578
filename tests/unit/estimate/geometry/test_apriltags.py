"""AprilTags on a dome: their detection, their centres, and a rig rotated to them."""

from dataclasses import replace

import numpy as np
import pytest
from domes import MARKS_DEG, SimulatedDome
from printed_tags import Printed, photograph, whiteness

from procam.estimate.geometry.apriltags import (
    TagObservations,
    detect_tags,
    tag_centre,
    tag_fiducials,
    tag_notes,
    to_8_bit,
)
from procam.estimate.geometry.model import RigGeometry
from procam.estimate.geometry.solve import solve_geometry
from procam.maths.codes.april_tags import TAG_SETS, find_tags, tag_cells
from procam.maths.geometry.lenses import Lens, project, unproject
from procam.maths.geometry.pose import Pose
from procam.maths.geometry.sphere import angle_between, normalise
from procam.model.optics import TAG_COUNTS, AprilTag, CameraModel, Sensor

SIZE = (1200, 1200)
FOCAL, RADIUS_M = 350.0, 6.0
LENS = Lens(
    "kannala-brandt",
    np.full(2, FOCAL),
    np.array([602.8, 597.4]),
    np.array([0.02, -0.008, 0.001, 0]),
)
# off the centre, so that the dome is seen at a slant
POSE = Pose.from_vectors((0.05, -0.03, 0.4), (-0.5, 0.4, -0.4))
CENTRE_RMS_PX = 0.05
ELEVATIONS_DEG = {20: 6, 45: 5, 70: 3}  # and how many go round at each


def tags_on_dome(edge_px: float, family: str = "36h11") -> list[Printed]:
    """Tags all over the dome, with edges of `edge_px` in the middle of the picture."""
    rng = np.random.default_rng(7)
    tags = []
    for elevation, count in ELEVATIONS_DEG.items():
        for turn in range(count):
            azimuth = 2 * np.pi * (turn + rng.uniform(0, 0.3)) / count
            place = (azimuth, np.radians(elevation), edge_px / FOCAL * RADIUS_M)
            roll = rng.uniform(0, 2 * np.pi)
            tags.append(Printed(len(tags), *place, roll, family))  # type: ignore[arg-type]
    return tags


def pixels(tags: list[Printed]) -> np.ndarray:
    """Where the camera sees their centres (N, 2)."""
    return np.array([project(POSE.apply(RADIUS_M * t.direction), LENS) for t in tags])


def picture_of(tags: list[Printed], rng: np.random.Generator, **how: float) -> np.ndarray:
    return photograph(whiteness(tags, LENS, SIZE, POSE, RADIUS_M), rng, **how)


def detect(
    tags: list[Printed], *pictures: np.ndarray, shown: frozenset[str] = frozenset()
) -> TagObservations:
    return detect_tags(pictures, LENS, [t.listed() for t in tags], shown)


@pytest.fixture(scope="module")
def forty() -> tuple[list[Printed], np.ndarray]:
    tags = tags_on_dome(40)
    return tags, picture_of(tags, np.random.default_rng(1))


class TestCentres:
    @pytest.mark.parametrize(("family", "edge_px"), [("36h11", 40), ("25h9", 40), ("16h5", 60)])
    def test_all_are_found_with_accurate_centres(self, rng, family: str, edge_px: float) -> None:
        tags = tags_on_dome(edge_px, family)
        found = detect(tags, picture_of(tags, rng))
        assert found.centres.keys() == {t.listed().name for t in tags}
        assert not found.doubled and not found.others
        error = np.array([found.centres[t.listed().name] for t in tags]) - pixels(tags)
        assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < CENTRE_RMS_PX

    def test_small_ones_are_found_in_a_larger_copy(self, rng) -> None:
        tags = tags_on_dome(14)
        picture = picture_of(tags, rng)
        once = {number for number, _ in find_tags(to_8_bit(picture), "36h11")}
        found = detect(tags, picture)
        assert len(once) < len(tags) == len(found.centres)
        error = np.array([found.centres[t.listed().name] for t in tags]) - pixels(tags)
        assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < CENTRE_RMS_PX

    def test_a_large_one_in_dim_light_and_noise(self, rng) -> None:
        tag = Printed(586, 0.3, 1.0, 100 / FOCAL * RADIUS_M, 1.0)
        found = detect([tag], picture_of([tag], rng, level=0.02, noise=3.0))
        assert found.centres["tag 586"] == pytest.approx(pixels([tag])[0], abs=0.1)

    def test_paper_that_saturates(self, rng) -> None:
        tags = tags_on_dome(40)[:8]
        found = detect(tags, picture_of(tags, rng, level=0.9))
        error = np.array([found.centres[t.listed().name] for t in tags]) - pixels(tags)
        assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < CENTRE_RMS_PX

    def test_other_patterns_have_no_centre(self, forty) -> None:
        picture = forty[1]
        corners = dict(find_tags(to_8_bit(picture), "36h11"))[3]
        assert tag_centre(picture, corners, tag_cells("36h11", 3), LENS) is not None
        assert tag_centre(picture, corners, tag_cells("36h11", 4), LENS) is None
        assert tag_centre(picture, corners + 40.0, tag_cells("36h11", 3), LENS) is None
        assert tag_centre(np.zeros_like(picture), corners, tag_cells("36h11", 3), LENS) is None


class TestDetection:
    def test_mirrored_tags_are_ignored(self, rng) -> None:
        tags = tags_on_dome(40)
        found = detect(tags, picture_of([replace(t, mirrored=True) for t in tags], rng))
        assert found == TagObservations()

    def test_dark_pictures_are_skipped(self, forty, rng) -> None:
        tags, picture = forty
        night = photograph(np.zeros(picture.shape), rng)
        assert not to_8_bit(night).any()
        assert detect(tags[:1], night, picture).centres.keys() == {"tag 0"}
        assert detect(tags[:1], night) == TagObservations()

    def test_no_more_pictures_are_read_than_needed(self, forty) -> None:
        tags, picture = forty

        def pictures():
            yield picture
            raise AssertionError("one is enough")

        assert detect_tags(pictures(), LENS, [tags[2].listed()]).centres.keys() == {"tag 2"}
        assert detect_tags(map(pytest.fail, ["not even one"]), LENS, []) == TagObservations()

    def test_unlisted_and_projected_tags_are_not_fiducials(self, forty) -> None:
        tags, picture = forty
        found = detect([replace(tags[0], number=99), tags[1]], picture, shown=frozenset({"tag 1"}))
        assert not found.centres
        assert found.others == {f"tag {i}" for i in range(len(tags)) if i != 1}

    def test_a_doubled_tag_is_not_used(self, rng) -> None:
        tags = tags_on_dome(40)[:3]
        found = detect(tags, picture_of([tags[0], tags[1], replace(tags[2], number=0)], rng))
        assert found == TagObservations(found.centres, {"tag 0"}, set())
        assert found.centres.keys() == {"tag 1"}

    def test_families_have_as_many_tags_as_in_opencv(self) -> None:
        for family, count in TAG_COUNTS.items():
            assert tag_cells(family, count - 1).any()
            with pytest.raises(Exception, match="bytesList"):
                tag_cells(family, count)
        assert TAG_SETS.keys() == TAG_COUNTS.keys()


class TestNotes:
    LISTED = (AprilTag("36h11", 7, 0.1, 0.2, 1e-4), AprilTag("25h9", 8, None, 0.3, 1e-4))

    def test_no_notes_when_all_are_seen(self) -> None:
        observed = {
            "a": TagObservations({"tag 7": np.zeros(2)}, set(), {"tag 3"}),
            "b": TagObservations({"tag 8 of 25h9": np.zeros(2)}),
        }
        assert tag_notes(self.LISTED, observed) == []

    def test_missing_tags_share_one_line(self) -> None:
        (line,) = tag_notes(self.LISTED, {"a": TagObservations()})
        assert str(line).startswith("tag 7, tag 8 of 25h9: no camera sees it; ")
        (line,) = tag_notes(
            self.LISTED, {"a": TagObservations({"tag 7": np.zeros(2)}, set(), {"tag 3"})}
        )
        assert str(line).startswith("tag 8 of 25h9: no camera")

    def test_unlisted_tags_are_named_if_no_listed_one_is_found(self) -> None:
        (line,) = tag_notes(
            self.LISTED,
            {"a": TagObservations({}, set(), {"tag 4", "tag 3"}), "b": TagObservations()},
        )
        assert "but tag 3, tag 4; " in str(line) and "correct family and id" in str(line)

    def test_doubled_ones(self) -> None:
        (line,) = tag_notes(self.LISTED[:1], {"a": TagObservations({}, {"tag 7"})})
        assert (
            str(line)
            == "tag 7: a sees it at several places and does not use it; take all but one down"
        )


class TestFiducials:
    def test_cameras_that_see_one_tag_share_its_survey_error(self) -> None:
        camera = CameraModel("a", SIZE, LENS, Sensor(12, 64.0))
        cameras = {"a": camera, "b": replace(camera, name="b")}
        tag = AprilTag("36h11", 7, 0.1, None, 1e-3)
        places = {"a": np.array([3.0, 4.0]), "b": np.array([5.0, 6.0])}
        marks = tag_fiducials(
            [tag], {n: TagObservations({"tag 7": p}) for n, p in places.items()}, cameras
        )
        assert [(m.name, m.device, m.azimuth, m.elevation) for m in marks] == [
            ("tag 7", "a", 0.1, None),
            ("tag 7", "b", 0.1, None),
        ]
        assert marks[1].pixel is places["b"]
        found = CENTRE_RMS_PX / FOCAL
        assert [m.sigma for m in marks] == pytest.approx([np.hypot(2**0.5 * 1e-3, found)] * 2)


def tags_seen(dome: SimulatedDome, tags: list[Printed], listed: list[AprilTag]) -> list:
    """The fiducials that all cameras of a dome find."""
    observed = {}
    for camera in dome.cameras:
        pose, radius_m = camera.camera_from_dome, dome.surface.preset.radius_m
        light = whiteness(tags, camera.lens, camera.size, pose, radius_m)
        observed[camera.name] = detect_tags([photograph(light, dome.rng)], camera.lens, listed)
    cameras = {c.name: CameraModel(c.name, c.size, c.lens, Sensor(12, 64.0)) for c in dome.cameras}
    return tag_fiducials(listed, observed, cameras)


@pytest.fixture(scope="module")
def dome() -> SimulatedDome:
    return SimulatedDome.build(5)


@pytest.fixture(scope="module")
def printed() -> list[Printed]:
    places = [np.radians(angles) for angles in MARKS_DEG.values()]
    return [Printed(7 + i, *place, 0.54, 0.5 * i) for i, place in enumerate(places)]


class TestGeometry:
    def test_tags_rotate_a_rig_as_clicked_fiducials_do(self, dome, printed) -> None:
        marks = tags_seen(dome, printed, [t.listed() for t in printed])
        assert len(marks) == len(printed) * len(dome.cameras)
        found = solve_geometry(dome.problem(dome.observations(48), fiducials=marks))
        assert not len(found.freedoms)
        assert worst_direction(found.rig, dome.rig()) < 5e-5  # a sixth of an arcminute


def worst_direction(found: RigGeometry, truth: RigGeometry) -> float:
    """Largest angle [rad] between estimated and true directions of pixels."""
    x, y = np.meshgrid(np.linspace(100, 1800, 9), np.linspace(100, 1100, 7))
    panel = np.stack([x, y], axis=-1).reshape(-1, 2)

    def directions(rig: RigGeometry, name: str) -> np.ndarray:
        projector = rig.projectors[name]
        back = projector.projector_from_dome.inverse()
        ray = back.rotate(unproject(panel, projector.lens))
        return normalise(rig.shape.intersect(np.broadcast_to(back.translation, ray.shape), ray))

    return max(
        float(angle_between(directions(found, name), directions(truth, name)).max())
        for name in truth.projectors
    )
