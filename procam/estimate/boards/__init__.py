"""Lens calibration from photographs of a flat board.

`targets` finds boards and tags in photographs; `start` computes initial values, `adjustment` fits
them and `robust_fit` rejects outliers; `camera` solves one camera, `planar_pair` a camera and a projector.
"""

from procam.estimate.boards.camera import BoardView, CameraFit, fit_camera, rms, view_residuals
from procam.estimate.boards.planar_pair import PairView, PlanarPair, fit_planar_pair, pair_view
from procam.estimate.boards.robust_fit import MIN_VIEWS, determines_pose
from procam.estimate.boards.start import homography_from_rays
from procam.estimate.boards.targets import Board, find_board, find_tags, suggest_squares, tag_cells

__all__ = [
    "MIN_VIEWS",
    "Board",
    "BoardView",
    "CameraFit",
    "PairView",
    "PlanarPair",
    "determines_pose",
    "find_board",
    "find_tags",
    "fit_camera",
    "fit_planar_pair",
    "homography_from_rays",
    "pair_view",
    "rms",
    "suggest_squares",
    "tag_cells",
    "view_residuals",
]
