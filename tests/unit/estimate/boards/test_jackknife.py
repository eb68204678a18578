"""The jackknife's single steps against refitting without each group, with the factors written out."""

from dataclasses import replace

import numpy as np
from simulated_boards import BEND, BOARD, PINHOLE, pinhole_views

from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import BoardRig, Corners, stack_corners
from procam.estimate.boards.left_out import jackknife_covariance
from procam.estimate.boards.robust_fit import IDENTITY
from procam.estimate.boards.start import pose_from_rays
from procam.maths.geometry.lenses import lens_parameters, unproject

FREE = (0, 1, 2, 3, 4)


def fitted(corners: Corners, rig: BoardRig) -> BoardRig:
    return BoardAdjustment(corners, (FREE,), np.array([1.0])).solve(rig)[0]


def part(places: np.ndarray, low: np.ndarray, high: np.ndarray, side: int) -> np.ndarray:
    column, row = np.minimum((places - low) / (high - low) * side, side - 1).astype(int).T
    return 100 * row + column


def test_covariance_equals_that_of_refits(rng) -> None:
    views = pinhole_views(rng, PINHOLE, 7)
    corners = stack_corners([v.points for v in views], [v.pixels[None] for v in views])
    boards = tuple(pose_from_rays(v.points, unproject(v.pixels, PINHOLE)) for v in views)
    rig = fitted(corners, BoardRig((PINHOLE,), (IDENTITY,), boards, BEND))
    pixels = corners.pixels[0]
    groupings = (
        np.repeat(np.arange(7), [len(v.points) for v in views]),
        part(pixels, pixels.min(axis=0), pixels.max(axis=0), 4),
        part(corners.points[:, :2], BOARD[0, :2], BOARD[-1, :2], 3),
    )
    expected = np.zeros((5, 5))
    for groups in groupings:
        fits = []
        for group in np.unique(groups):
            rest = replace(corners, use=corners.use & (groups != group))
            fits.append(lens_parameters(fitted(rest, rig).lenses[0])[:5])
        away = np.array(fits) - np.mean(fits, axis=0)
        expected += (len(fits) - 1) / len(fits) * away.T @ away / 2
    covariance = jackknife_covariance(BoardAdjustment(corners, (FREE,), np.array([1.0])), rig)
    # one step from the solution differs from a refit in second order
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.02
    )
