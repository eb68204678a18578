"""Residuals of board corners, and their robust scatter."""

import numpy as np
from simulated_boards import BOARD, PINHOLE, looking_at

from procam.estimate.boards.corners import BoardRig, residual_sigmas, residuals, stack_corners
from procam.maths.geometry.lenses import project
from procam.maths.geometry.pose import Pose


def test_residuals_are_predicted_minus_observed() -> None:
    pose = looking_at(0.1, 0.0, np.zeros(3), 0.3)
    pixels = project(pose.apply(BOARD), PINHOLE) + np.array([1.0, -2.0])
    corners = stack_corners([BOARD], [pixels[None]])
    rig = BoardRig((PINHOLE,), (Pose(np.eye(3), np.zeros(3)),), (pose,), np.zeros(3))
    np.testing.assert_allclose(
        residuals(corners, rig)[0], np.tile([-1.0, 2.0], (len(BOARD), 1)), atol=1e-9
    )


def test_sigma_ignores_outliers_and_unused_corners(rng) -> None:
    corners = stack_corners([BOARD], [np.zeros((1, len(BOARD), 2))])
    error = rng.normal(0, 0.5, (1, len(BOARD), 2))
    error[0, :20] = 40.0
    error[0, 20:30] = np.nan
    corners.use[0, 20:30] = False
    # a sixth of outliers raises the median by a quarter
    np.testing.assert_allclose(residual_sigmas(corners, error), 0.5, rtol=0.4)


def test_the_corners_of_some_views() -> None:
    pixels = [np.zeros((2, n, 2)) for n in (3, 4)]
    corners = stack_corners([BOARD[:3], BOARD[:4]], pixels).only([1])
    np.testing.assert_array_equal(corners.use, [[0] * 3 + [1] * 4] * 2)
    np.testing.assert_array_equal(corners.view_of, [0] * 3 + [1] * 4)
