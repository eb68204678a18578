"""Standard errors that hold when the lens or the board is not quite as modelled.

The scatter of corners about a fit shows what noise alone does. Errors of the model repeat: all corners
of a view share its blur and its pose, a part of the picture the misfit of the lens, a part of the board
its print and its curl. The jackknife leaves out one such group at a time (docs/theory/geometry.md).
"""

from dataclasses import replace

import numpy as np

from procam.arrays import Array, IndexArray
from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import BoardRig, Corners

PICTURE_PARTS, BOARD_PARTS = 4, 3  # per side
SHARE = 0.5  # of the sum: every one of the three jackknives also holds the noise


def jackknife_covariance(adjustment: BoardAdjustment, rig: BoardRig) -> Array:
    """Covariance (S, S) of the shared parameters at the fit `rig`, errors of the model included.

    Order: as in `BoardAdjustment.covariance`. The equation is docs/theory/geometry.md (G6).
    """
    parts = [_leave_out(adjustment, rig, groups) for groups in _groupings(adjustment.corners)]
    return np.asarray(SHARE * np.sum(parts, axis=0))


def _leave_out(adjustment: BoardAdjustment, rig: BoardRig, groups: IndexArray) -> Array:
    """Delete-one-group jackknife (S, S); groups (D, T) number the group of each observation."""
    corners = adjustment.corners
    rests = (corners.use & (groups != g) for g in np.unique(groups[corners.use]))
    steps = np.array(
        [replace(adjustment, corners=replace(corners, use=use)).shared_step(rig) for use in rests]
    )
    away = steps - steps.mean(axis=0)
    return np.asarray((len(steps) - 1) / len(steps) * away.T @ away)


def _groupings(corners: Corners) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Groups (D, T) of the observations by view, by part of each picture, by part of the board."""
    devices = len(corners.pixels)
    board = _parts(corners.points[:, :2], corners.area, BOARD_PARTS)
    pictures = [
        device * PICTURE_PARTS**2 + _parts(pixels, _extent(pixels[use]), PICTURE_PARTS)
        for device, (pixels, use) in enumerate(zip(corners.pixels, corners.use, strict=True))
    ]
    return np.tile(corners.view_of, (devices, 1)), np.stack(pictures), np.tile(board, (devices, 1))


def _extent(places: Array) -> Array:
    return np.stack([places.min(axis=0), places.max(axis=0)])


def _parts(places: Array, area: Array, side: int) -> IndexArray:
    """Number (N,) of the part, `side` by `side`, of an area (2, 2) that places (N, 2) lie in."""
    share = np.nan_to_num((places - area[0]) / (area[1] - area[0]))
    column, row = np.clip(share * side, 0, side - 1).astype(int).T
    return np.asarray(side * row + column)
