"""A camera and a projector on a flat board: simulated views, and six published rendered sessions."""

import numpy as np
import pytest
from real_captures import GSOUP_SESSIONS, GSOUP_SIZE, gsoup_session
from tolerances import SIGMAS

from procam.errors import CalibrationError, NotEnoughData
from procam.estimate.boards.camera import rms
from procam.estimate.boards.planar_pair import (
    PairView,
    fit_planar_pair,
    pair_view,
)
from procam.estimate.boards.projector_corners import projector_corners
from procam.estimate.boards.targets import Board, find_board
from procam.maths.geometry.lenses import Lens, project
from procam.maths.geometry.pose import Pose, rotation_matrix, rotation_vector
from procam.model.correspondence import CorrespondenceMap

GSOUP_BOARD = Board("checkerboard", (16, 16), 0.0185)


def session(name: str) -> PairView:
    """Corners in full-frame camera pixels and their projector pixels."""
    white, decoded, offset = gsoup_session(name)
    board = find_board(white, GSOUP_BOARD)
    assert board is not None
    view = pair_view(name, *board, decoded.map)
    return PairView(name, view.points, view.camera_px + offset, view.projector_px)


class TestSixSessions:
    """Blender's own numbers: f 800, c 399.5, 0.3 m between camera and projector."""

    def test_truth(self) -> None:
        pair = fit_planar_pair([session(s) for s in GSOUP_SESSIONS], GSOUP_SIZE, GSOUP_SIZE)
        turn = rotation_matrix([0.24285, 0.12374, 0.01512])
        shift = np.array([-0.12403, 0.23891, -0.13242])
        miss = pair.projector_from_camera.translation - shift
        print(pair.camera, pair.projector, f"baseline off by {np.linalg.norm(miss) * 1e3:.2f} mm")
        for lens in (pair.camera, pair.projector):
            np.testing.assert_allclose(lens.focal, 800, atol=2)
            np.testing.assert_allclose(lens.centre, 399.5, atol=1.5)
        off = rotation_vector(pair.projector_from_camera.rotation @ turn.T)
        assert np.degrees(np.linalg.norm(off)) < 0.05
        assert np.linalg.norm(miss) < 1e-3


CAMERA = Lens(
    "brown",
    np.array([1210.0, 1208.0]),
    np.array([640.0, 508.0]),
    np.array([-0.1, 0.04, 1e-3, -5e-4, 0.01]),
)
# lens shift puts the principal point below the panel
PROJECTOR = Lens(
    "brown",
    np.array([1810.0, 1815.0]),
    np.array([655.0, 905.0]),
    np.array([0.05, -0.03, 0.0, 2e-4, 0.01]),
)
CAMERA_SIZE, PROJECTOR_SIZE = (1280, 1024), (1280, 800)
POSE = Pose.from_vectors((0.15, -0.3, 0.02), (0.287, -0.125, 0.03))
BOARD = Board("checkerboard", (12, 9), 0.03).corners_m
NOISE_PX = (0.05, 0.1)


def rolled(board: np.ndarray, radius_m: float) -> np.ndarray:
    """The board bent about the y axis to a cylinder, no length changed."""
    angle = (board[:, 0] - board[:, 0].mean()) / radius_m
    middle = board[:, 0].mean()
    return np.c_[middle + radius_m * np.sin(angle), board[:, 1], radius_m * (1 - np.cos(angle))]


def simulated(
    rng: np.random.Generator,
    number: int,
    camera: Lens,
    projector: Lens,
    board: np.ndarray = BOARD,
) -> list[PairView]:
    views = []
    for i in range(number):
        turn = rotation_matrix(rng.normal(0, 0.35, 3) * [1, 1, 0.4])
        place = np.array([*rng.uniform(-0.08, 0.08, 2), rng.uniform(0.8, 1.2)])
        points = Pose(turn, place - turn @ BOARD.mean(axis=0)).apply(board)
        seen = project(points, camera) + rng.normal(0, NOISE_PX[0], (len(BOARD), 2))
        lit = project(POSE.apply(points), projector) + rng.normal(0, NOISE_PX[1], (len(BOARD), 2))
        beside = ((lit < 0) | (lit > np.array(PROJECTOR_SIZE) - 1)).any(axis=1)
        lit[beside] = np.nan
        views.append(PairView(str(i), BOARD, seen, lit))
    return views


def plain(lens: Lens) -> Lens:
    return Lens(lens.kind, lens.focal, lens.centre, np.zeros(5))


class TestTruth:
    @pytest.mark.parametrize("distortion", [False, True])
    def test_parameters_lie_within_their_sigmas(self, rng, distortion: bool) -> None:
        camera, projector = (lens if distortion else plain(lens) for lens in (CAMERA, PROJECTOR))
        views = simulated(rng, 8, camera, projector)
        views[3].projector_px[20] += [7.0, -3.0]
        views[5].camera_px[40] += [-4.0, 9.0]
        pair = fit_planar_pair(views, CAMERA_SIZE, PROJECTOR_SIZE)
        assert [(d.view, d.index) for d in pair.dropped["projector"]] == [("3", 20)]
        assert [(d.view, d.index) for d in pair.dropped["camera"]] == [("5", 40)]
        terms = 9 if distortion else 4
        miss = [
            np.r_[found.focal, found.centre, found.distortion][:terms]
            - np.r_[true.focal, true.centre, true.distortion][:terms]
            for found, true in ((pair.camera, camera), (pair.projector, projector))
        ]
        turn = rotation_vector(pair.projector_from_camera.rotation @ POSE.rotation.T)
        shift = pair.projector_from_camera.translation - POSE.translation
        z = np.r_[*miss, turn, shift] / np.sqrt(np.diag(pair.covariance))
        assert np.abs(z).max() < SIGMAS, z
        assert len(pair.covariance) == 2 * terms + 6

    def test_a_bent_board_is_solved(self, rng) -> None:
        """Rolled to a cylinder of 2 m, the board rises by 7 mm at its ends."""
        views = simulated(rng, 6, CAMERA, PROJECTOR, board=rolled(BOARD, 2.0))
        pair = fit_planar_pair(views, CAMERA_SIZE, PROJECTOR_SIZE)
        half = np.linalg.norm(BOARD[-1] - BOARD[0]) / 2
        assert pair.bend[0] == pytest.approx(half**2 / (2 * 2.0), rel=0.05)
        assert np.abs(pair.bend[1:]).max() < 1e-3
        sigma = np.sqrt(np.diag(pair.covariance))
        for lens, true, at in ((pair.camera, CAMERA, 0), (pair.projector, PROJECTOR, 9)):
            miss = np.r_[lens.focal, lens.centre] - np.r_[true.focal, true.centre]
            assert (np.abs(miss) < SIGMAS * sigma[at : at + 4]).all()
        assert 0.05 < min(rms(left) for left in pair.held_out_px.values())

    def test_a_pose_in_which_a_device_moved_is_left_out(self, rng) -> None:
        views = simulated(rng, 9, plain(CAMERA), plain(PROJECTOR))
        views[4].projector_px[:] = rng.uniform(100, 700, views[4].projector_px.shape)
        pair = fit_planar_pair(views, CAMERA_SIZE, PROJECTOR_SIZE)
        assert pair.dropped_views == ("4",)
        assert "4" not in pair.boards
        assert all("4" not in left for left in pair.held_out_px.values())

    def test_corner_coordinates_from_a_rounded_map(self, rng) -> None:
        """Whole projector pixels, 2 % of them misread: the fit of a window averages the rounding."""
        tilted = np.array([[1.3, 0.1, 40.0], [-0.05, 1.2, 30.0], [2e-4, 1e-4, 1.0]])
        rows, columns = np.indices((200, 240))
        ahead = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ tilted.T
        xy = np.rint(ahead[..., :2] / ahead[..., 2:]).astype(np.float32)
        xy[rng.random((200, 240)) < 0.02] = 5.0
        valid = np.ones((200, 240), bool)
        valid[:, 150:] = False
        found = CorrespondenceMap(xy, np.full_like(xy, 0.3), valid)
        x, y = np.meshgrid(np.arange(20, 230, 16.0), np.arange(20, 190, 16.0))
        corners = np.stack([x, y], axis=-1).reshape(-1, 2) + 0.37
        lit = projector_corners(found, corners)
        truth = np.c_[corners, np.ones(len(corners))] @ tilted.T
        miss = lit - truth[:, :2] / truth[:, 2:]
        inside = corners[:, 0] < 140
        assert np.sqrt(np.mean(miss[inside] ** 2)) < 0.05
        assert np.isnan(lit[corners[:, 0] > 160]).all()


class TestRefusals:
    def test_too_few_views(self, rng) -> None:
        with pytest.raises(NotEnoughData, match="only 2 of the board; at least 3"):
            fit_planar_pair(simulated(rng, 2, CAMERA, PROJECTOR), CAMERA_SIZE, PROJECTOR_SIZE)

    def test_parallel_boards(self, rng) -> None:
        views = []
        for i in range(4):
            points = BOARD + np.array([-0.15 + 0.02 * i, -0.1, 0.9 + 0.1 * i])
            lit = project(POSE.apply(points), PROJECTOR)
            views.append(PairView(str(i), BOARD, project(points, CAMERA), lit))
        with pytest.raises(NotEnoughData, match="all boards are parallel"):
            fit_planar_pair(views, CAMERA_SIZE, PROJECTOR_SIZE)

    def test_a_board_outside_the_projectors_picture(self, rng) -> None:
        views = simulated(rng, 4, CAMERA, PROJECTOR)
        views[1].projector_px[5:] = np.nan
        with pytest.raises(
            NotEnoughData, match=r"1: the projector lights 5 of 88 corners; .* 1280x800"
        ):
            fit_planar_pair(views, CAMERA_SIZE, PROJECTOR_SIZE)

    def test_a_mirrored_picture(self, rng) -> None:
        views = simulated(rng, 6, plain(CAMERA), plain(PROJECTOR))
        for view in views:
            view.projector_px[:, 0] = 1279 - view.projector_px[:, 0]
        with pytest.raises(CalibrationError, match="its picture is mirrored"):
            fit_planar_pair(views, CAMERA_SIZE, PROJECTOR_SIZE)
