"""Lenses against OpenCV: a half pixel or a sign wrong here would cancel in every simulation."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tolerances import CLOSED_FORM, OPENCV_PX, SOLVER

from procam.maths.geometry.lenses import Lens, project, unproject

BROWN = [
    np.zeros(5),
    np.array([-0.3, 0.1, 0.0, 0.0, 0.0]),
    np.array([0.1, -0.05, 0.003, -0.002, 0.01]),
    np.array([-0.02, 0.002, -0.004, 0.005, 0.0]),
]
FISHEYE = [np.zeros(4), np.array([0.02, -0.008, 0.001, 0.0]), np.array([-0.03, 0.01, -0.002, 2e-4])]


def _brown(k: np.ndarray) -> Lens:
    return Lens("brown", np.array([910.0, 905.0]), np.array([639.5, -12.25]), k)


def _fisheye(k: np.ndarray) -> Lens:
    return Lens("kannala-brandt", np.array([465.1, 466.2]), np.array([802.8, 797.4]), k)


def _matrix(lens: Lens) -> np.ndarray:
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


@pytest.fixture
def points(rng: np.random.Generator) -> np.ndarray:
    return np.concatenate([rng.uniform(-1, 1, (500, 2)), rng.uniform(1.2, 5.0, (500, 1))], axis=1)


class TestAgainstOpenCv:
    @pytest.mark.parametrize("k", BROWN)
    def test_brown(self, points: np.ndarray, k: np.ndarray) -> None:
        lens = _brown(k)
        expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), _matrix(lens), k)
        np.testing.assert_allclose(project(points, lens), expected[:, 0], rtol=0, atol=OPENCV_PX)

    @pytest.mark.parametrize("k", FISHEYE)
    def test_fisheye(self, points: np.ndarray, k: np.ndarray) -> None:
        lens = _fisheye(k)
        points[:, 2] /= 10  # out to 80 degrees
        expected, _ = cv2.fisheye.projectPoints(
            points[None], np.zeros(3), np.zeros(3), _matrix(lens), k
        )
        np.testing.assert_allclose(project(points, lens), expected[0], rtol=0, atol=OPENCV_PX)

    def test_rays_of_brown_pixels(self) -> None:
        lens = _brown(BROWN[3])
        pixels = np.array([[0.0, 0.0], [1279.0, 799.0], [640.5, 3.25]])
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-14)
        plane = cv2.undistortPoints(
            pixels[:, None], _matrix(lens), lens.distortion, criteria=criteria
        )[:, 0]
        ray = unproject(pixels, lens)
        np.testing.assert_allclose(ray[:, :2] / ray[:, 2:], plane, rtol=0, atol=SOLVER)


class TestConvention:
    def test_equidistant_fisheye_is_focal_times_angle(self) -> None:
        lens = _fisheye(np.zeros(4))
        theta = np.radians(100.0)
        seen = project(np.array([np.sin(theta), 0.0, np.cos(theta)]), lens)
        assert seen[0] - lens.centre[0] == pytest.approx(lens.focal[0] * theta, rel=CLOSED_FORM)

    def test_a_pinhole_sees_nothing_behind_itself(self) -> None:
        seen = project(np.array([[0.1, 0.1, -1.0], [0.1, 0.1, 0.0]]), _brown(BROWN[0]))
        assert np.isnan(seen).all()

    @pytest.mark.parametrize("lens", [_brown(BROWN[2]), _fisheye(FISHEYE[1])])
    def test_no_pixels_give_no_rays(self, lens: Lens) -> None:
        assert unproject(np.zeros((0, 2)), lens).shape == (0, 3)

    @pytest.mark.parametrize("lens", [_brown(BROWN[2]), _fisheye(FISHEYE[1])])
    def test_unknown_pixels_give_unknown_rays_alone(self, lens: Lens) -> None:
        rays = unproject(np.array([[np.nan, np.nan], [650.0, 100.0]]), lens)
        assert np.isnan(rays[0]).all() and np.isfinite(rays[1]).all()


def _coefficients(*limits: float) -> st.SearchStrategy[np.ndarray]:
    return st.tuples(*(st.floats(-limit, limit) for limit in limits)).map(np.array)


class TestRoundTrip:
    @given(
        k=_coefficients(0.1, 0.02, 0.005, 0.005, 0.002),
        x=st.floats(-0.7, 0.7),
        y=st.floats(-0.7, 0.7),
    )
    def test_brown(self, k: np.ndarray, x: float, y: float) -> None:
        ray = np.array([[x, y, 1.0]]) / np.sqrt(x * x + y * y + 1)
        np.testing.assert_allclose(unproject(project(ray, _brown(k)), _brown(k)), ray, atol=SOLVER)

    @given(
        k=_coefficients(0.03, 0.005, 0.001, 0.0001),
        theta=st.floats(0, np.radians(100.0)),
        azimuth=st.floats(-np.pi, np.pi),
    )
    def test_fisheye_beyond_90_degrees(self, k: np.ndarray, theta: float, azimuth: float) -> None:
        sine = np.sin(theta)
        ray = np.array([[sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)]])
        back = unproject(project(ray, _fisheye(k)), _fisheye(k))
        np.testing.assert_allclose(back, ray, atol=SOLVER)

    @given(x=st.floats(0, 1279), y=st.floats(0, 799))
    def test_pixel_to_ray_and_back(self, x: float, y: float) -> None:
        for lens in (_brown(BROWN[3]), _fisheye(FISHEYE[1])):
            ray = unproject(np.array([[x, y]]), lens)
            assert np.linalg.norm(ray) == pytest.approx(1, abs=CLOSED_FORM)
            np.testing.assert_allclose(project(ray, lens), [[x, y]], atol=SOLVER)
