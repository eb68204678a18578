"""Board fits without a part of the corners: cross-validation, and standard errors by the jackknife.

Views left out in turn decide between models of lens and board. Standard errors hold when the lens or the
board is not quite as modelled: the scatter of corners about a fit shows what noise alone does, but errors of
the model repeat: all corners of a view share its blur and its pose, a part of the picture the misfit of the
lens, a part of the board its print and its curl. The jackknife leaves out one such group at a time
(docs/theory/geometry.md).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from procam.arrays import Array, IndexArray
from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import (
    MIN_SIGMA_PX,
    BoardRig,
    Corners,
    residual_sigmas,
    residuals,
)
from procam.estimate.boards.robust_fit import BoardFit, fit_poses

CLEARLY_SIGMAS, CLEARLY_GAIN = 2.0, 0.1  # of the mean logarithm of the residuals' ratio; at least
PICTURE_PARTS, BOARD_PARTS = 4, 3  # per side
SHARE = 0.5  # of the sum: every one of the three jackknives also holds the noise


def held_out_residuals(fit: BoardFit, corners: Corners, rig: BoardRig, folds: int) -> Array:
    """Predicted minus observed (D, T, 2) [px] of every view in a fit without it; NaN where not in use.

    `rig` is the fit to all views; of the views left out only the poses are fitted.
    """
    used = [i for i, view in enumerate(corners.views) if corners.use[:, view].any()]
    error = np.full_like(corners.pixels, np.nan)
    for fold in range(min(folds, len(used))):
        test = used[fold::folds]
        train = corners.only([i for i in used if i not in test])
        fitted, _ = fit.adjustment(train, rig).solve(rig)
        tested = corners.only(test)
        error[tested.use] = residuals(tested, fit_poses(tested, fitted))[tested.use]
    return error


def best_model(
    models: Sequence[BoardFit], corners: Corners, rig: BoardRig, folds: int
) -> tuple[BoardFit, BoardRig]:
    """The model that predicts views left out best, and its fit to all; the first of equals.

    `rig` is the fit of the richest model. Squares count over the noise of their device.
    """
    sigma = residual_sigmas(corners, residuals(corners, rig))

    def score(candidate: tuple[BoardFit, BoardRig]) -> float:
        squared = np.sum(
            held_out_residuals(candidate[0], corners, candidate[1], folds) ** 2, axis=2
        )
        share = squared / sigma[:, None] ** 2
        means = [np.mean(row[use]) for row, use in zip(share, corners.use, strict=True)]
        return float(np.nan_to_num(np.sum(means), nan=np.inf))

    fitted = [(model, _fit(model, corners, rig)) for model in models]
    return min(fitted, key=score)


def clearly_better(one: Mapping[str, Array], other: Mapping[str, Array]) -> bool:
    """Whether `one` predicts the views that both left out better than `other` does, beyond chance.

    Both hold the residuals (N, 2) [px] of every view in a fit without it.
    """
    common = [view for view in one if view in other]
    if len(common) < 2:
        return False
    # logarithms: a view that a bad model cannot predict at all is still one view
    size = [[np.mean(np.sum(fit[view] ** 2, axis=1)) for view in common] for fit in (one, other)]
    gain = np.diff(np.log(np.maximum(size, MIN_SIGMA_PX**2)) / 2, axis=0)[0]
    surely = gain.mean() > CLEARLY_SIGMAS * gain.std(ddof=1) / np.sqrt(len(gain))
    return bool(surely and gain.mean() > CLEARLY_GAIN)


def _fit(model: BoardFit, corners: Corners, rig: BoardRig) -> BoardRig:
    start = model.simplified(rig)
    return model.adjustment(corners, start).solve(start)[0]


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
