"""Geometry from exact observations is exact; from noisy ones, as sure as it says it is."""

from dataclasses import replace

import numpy as np
import pytest
from tolerances import CLOSED_FORM, SIGMAS, SOLVER

from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.geometry import (
    Observations,
    camera_points,
    gather,
    locate_camera,
    solve_geometry,
    sphere_test,
)
from procam.maths.lenses import Lens, project
from procam.maths.pose import Pose
from procam.maths.sphere import direction_from_angles, normalise
from procam.model.correspondence import CorrespondenceMap
from procam.model.optics import CameraModel, Fiducial, ProjectorModel, Sensor
from procam.model.screen import Dome

RADIUS_M = 6.0
DOME = Dome(RADIUS_M, np.pi / 2)
EXACT = 1e-6  # radian, or of the radius: fiducials alone hold the camera's turn, and weigh little
MARKS_DEG = {"front": (12.0, 35.0), "left": (130.0, 30.0), "right": (-110.0, 50.0), "up": (40, 80)}


def _camera() -> CameraModel:
    lens = Lens(
        "kannala-brandt",
        np.full(2, 230.0),
        np.array([400.5, 397.25]),
        np.array([0.02, -0.008, 0, 0]),
    )
    rotation = Pose.from_vectors((0.05, -0.03, 0.4), (0, 0, 0)).rotation
    pose = Pose(rotation, -rotation @ np.array([0.48, -0.36, 0.54]))
    return CameraModel("zenith", (800, 800), lens, Sensor(12, 64.0), pose)


def _projector(azimuth: float) -> ProjectorModel:
    place = RADIUS_M * np.array([-0.95 * np.cos(azimuth), -0.95 * np.sin(azimuth), 0.08])
    aim = direction_from_angles(azimuth + 0.02, np.radians(25.0))
    right = normalise(np.cross(aim, [0.0, 0.0, 1.0]))
    rotation = np.stack([right, np.cross(aim, right), aim])
    lens = Lens(
        "brown",
        np.array([575.0, 577.0]),
        np.array([642.0, 481.0]),
        np.array([-0.02, 0.002, 0.0, 0.0, 0.0]),
    )
    return ProjectorModel("p", (1280, 800), lens, Pose(rotation, -rotation @ place))


CAMERA = _camera()
PROJECTORS = {"south": _projector(0.0), "north": _projector(np.pi)}
SIZES = {name: p.size for name, p in PROJECTORS.items()}


def _fiducials(camera: CameraModel = CAMERA, count: int = 4) -> list[Fiducial]:
    marks = []
    for name, (azimuth, elevation) in list(MARKS_DEG.items())[:count]:
        direction = direction_from_angles(np.radians(azimuth), np.radians(elevation))
        pixel = project(camera.camera_from_dome.apply(RADIUS_M * direction), camera.lens)
        marks.append(Fiducial(name, direction, np.radians(0.01), camera.name, pixel))
    return marks


def _observations(step: int = 20) -> dict[str, Observations]:
    """What a perfect camera would decode on a grid of its pixels."""
    grid = np.stack(np.meshgrid(*[np.arange(60.0, 741.0, step)] * 2), axis=-1).reshape(-1, 2)
    points = camera_points(CAMERA, DOME, grid)
    grid = grid[points[:, 2] > 0.1 * RADIUS_M]
    points = camera_points(CAMERA, DOME, grid)
    found = {}
    for name, projector in PROJECTORS.items():
        seen = project(projector.projector_from_dome.apply(points), projector.lens)
        width, height = projector.size
        inside = np.all((seen >= 0) & (seen <= [width - 1, height - 1]), axis=1)
        found[name] = Observations(grid[inside], seen[inside])
    return found


def _mirrored(obs: Observations) -> Observations:
    return Observations(obs.camera_px, obs.projector_px * [-1, 1] + [1279, 0])


class TestExact:
    def test_recovers_camera_and_projectors(self) -> None:
        found = solve_geometry(CAMERA, DOME, _fiducials(), _observations(), SIZES)
        _assert_pose(found.camera.camera_from_dome, CAMERA.camera_from_dome)
        for name, truth in PROJECTORS.items():
            projector = found.projectors[name]
            _assert_pose(projector.projector_from_dome, truth.projector_from_dome)
            np.testing.assert_allclose(projector.lens.focal, truth.lens.focal, rtol=EXACT)
            np.testing.assert_allclose(projector.lens.centre, truth.lens.centre, rtol=EXACT)
            np.testing.assert_allclose(projector.lens.distortion, truth.lens.distortion, atol=EXACT)
            assert np.abs(found.residual_px[name]).max() < SOLVER

    def test_a_few_wrong_blocks_do_no_harm(self, rng: np.random.Generator) -> None:
        observations = _observations()
        south = observations["south"]
        south.projector_px[:] += rng.normal(0, 1e-4, south.projector_px.shape)
        bad = rng.choice(len(south.camera_px), 15, replace=False)
        south.projector_px[bad] += rng.uniform(10, 60, (15, 2))
        found = solve_geometry(CAMERA, DOME, _fiducials(), observations, SIZES)
        assert len(found.residual_px["south"]) == len(south.camera_px) - 15
        assert np.abs(found.residual_px["south"]).max() < 6e-4
        squared = _squared_distance(found.projectors["south"], PROJECTORS["south"])
        assert squared < 12 + SIGMAS * np.sqrt(2 * 12)

    def test_needs_no_start_value_for_the_camera(self) -> None:
        lost = replace(CAMERA, camera_from_dome=None)
        _assert_pose(
            locate_camera(lost, DOME, _fiducials()).camera_from_dome, CAMERA.camera_from_dome
        )

    def test_points_lie_on_the_sphere_where_the_pixel_looks(self) -> None:
        pixels = np.array([[100.0, 400.0], [400.5, 397.25], [620.0, 300.0]])
        points = camera_points(CAMERA, DOME, pixels)
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), RADIUS_M, rtol=CLOSED_FORM)
        back = project(CAMERA.camera_from_dome.apply(points), CAMERA.lens)
        np.testing.assert_allclose(back, pixels, atol=SOLVER)


class TestNoise:
    """Predicted covariance against what repeated noise really does."""

    SIGMA_PX = 0.1
    REPEATS = 24

    @pytest.fixture(scope="class")
    @classmethod
    def normalised(cls) -> np.ndarray:
        """(REPEATS,) squared error of a projector's 12 parameters in units of its covariance."""
        rng = np.random.default_rng(7)
        clean, truth = _observations(step=40), PROJECTORS["south"]
        marks = _fiducials()
        squared = []
        for _ in range(cls.REPEATS):
            noisy = {
                n: Observations(
                    o.camera_px, o.projector_px + rng.normal(0, cls.SIGMA_PX, o.projector_px.shape)
                )
                for n, o in clean.items()
            }
            moved = [replace(m, pixel=m.pixel + rng.normal(0, m.sigma * 230.0, 2)) for m in marks]
            found = solve_geometry(CAMERA, DOME, moved, noisy, SIZES).projectors["south"]
            squared.append(_squared_distance(found, truth))
        return np.array(squared)

    def test_errors_are_as_large_as_predicted(self, normalised: np.ndarray) -> None:
        """Each is chi-squared with 12 degrees of freedom; outliers dropped at 6 sigma are rare."""
        mean, sigma = 12.0, np.sqrt(2 * 12 / self.REPEATS)
        assert abs(normalised.mean() - mean) < SIGMAS * sigma


def _squared_distance(found: ProjectorModel, truth: ProjectorModel) -> float:
    turn = found.projector_from_dome.rotation @ truth.projector_from_dome.rotation.T
    rotation = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    shift = found.projector_from_dome.translation - turn @ truth.projector_from_dome.translation
    step = np.r_[
        rotation,
        shift,
        found.lens.focal - truth.lens.focal,
        found.lens.centre - truth.lens.centre,
        (found.lens.distortion - truth.lens.distortion)[:2],
    ]
    assert found.covariance is not None
    return float(step @ np.linalg.solve(found.covariance, step))


class TestRefusals:
    def test_too_few_fiducials(self) -> None:
        with pytest.raises(NotEnoughData, match=r"camera zenith: got 2 fiducials, .* at least 3"):
            locate_camera(CAMERA, DOME, _fiducials(count=2))

    def test_fiducials_of_another_camera_do_not_count(self) -> None:
        marks = [replace(m, camera="other") for m in _fiducials()]
        with pytest.raises(NotEnoughData, match="got 0 fiducials"):
            locate_camera(CAMERA, DOME, marks)

    def test_a_fiducial_in_the_wrong_place(self) -> None:
        marks = _fiducials()
        marks[1] = replace(marks[1], pixel=marks[1].pixel + np.array([90.0, 120.0]))
        with pytest.raises(CalibrationError, match=r"the fiducials miss by .* px at best"):
            locate_camera(CAMERA, DOME, marks)

    def test_a_projector_that_was_hardly_seen(self) -> None:
        observations = _observations()
        few = observations["north"]
        observations["north"] = Observations(few.camera_px[:59], few.projector_px[:59])
        with pytest.raises(NotEnoughData, match=r"projector north: got 59 decoded blocks"):
            solve_geometry(CAMERA, DOME, _fiducials(), observations, SIZES)

    def test_a_mirrored_projector(self) -> None:
        observations = _observations()
        observations["south"] = _mirrored(observations["south"])
        with pytest.raises(CalibrationError, match=r"projector south: .* mirrored"):
            solve_geometry(CAMERA, DOME, _fiducials(), observations, SIZES)


class TestGather:
    def test_means_over_full_blocks(self) -> None:
        y, x = np.mgrid[0:24, 0:32].astype(np.float32)
        valid = np.ones((24, 32), bool)
        valid[0:8, 8:16] = False  # one block gone
        valid[9, 17] = False  # one pixel of 64: the block stays, its means move
        valid[16:18, 24:28] = False  # 8 of 64: too many
        xy = np.stack([2 * x + 5, 100 - y], axis=-1)
        xy[~valid] = np.nan
        found = gather(CorrespondenceMap(xy, np.ones((24, 32), np.float32), valid), 8)
        assert len(found.camera_px) == 12 - 2
        expected = np.stack([2 * found.camera_px[:, 0] + 5, 100 - found.camera_px[:, 1]], axis=1)
        np.testing.assert_allclose(found.projector_px, expected, rtol=1e-5)
        np.testing.assert_allclose(found.camera_px[0], [3.5, 3.5], rtol=1e-6)


class TestSphere:
    def _solution(self, ripple_px: float) -> tuple[float, float]:
        rng = np.random.default_rng(3)
        observations = _observations(step=8)
        for obs in observations.values():
            wave = ripple_px * np.sin(obs.camera_px / 60.0)
            obs.projector_px[:] += rng.normal(0, 0.05, obs.projector_px.shape) + wave
        return sphere_test(solve_geometry(CAMERA, DOME, _fiducials(), observations, SIZES), DOME)

    def test_noise_alone_is_a_sphere(self) -> None:
        ratio, systematic = self._solution(0.0)
        assert 0.7 < ratio < 1.5
        assert systematic < 0.1  # noise of a mean over 64 blocks

    def test_a_ripple_is_none(self) -> None:
        ratio, systematic = self._solution(0.3)
        assert ratio > 5
        assert systematic > 0.5


def _assert_pose(found: Pose | None, truth: Pose | None) -> None:
    assert found is not None and truth is not None
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=EXACT)
    np.testing.assert_allclose(found.translation, truth.translation, atol=EXACT * RADIUS_M)
