"""Cross-validation of board fits: views left out in turn decide between models of lens and board."""

from collections.abc import Mapping, Sequence

import numpy as np

from procam.arrays import Array
from procam.estimate.boards.corners import (
    MIN_SIGMA_PX,
    BoardRig,
    Corners,
    residual_sigmas,
    residuals,
)
from procam.estimate.boards.robust_fit import BoardFit, fit_poses

CLEARLY_SIGMAS, CLEARLY_GAIN = 2.0, 0.1  # of the mean logarithm of the residuals' ratio; at least


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
