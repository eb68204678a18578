"""Views left out of a fit decide between models; the residuals are those of a fit without them."""

import numpy as np
import pytest
from simulated_boards import BEND, PINHOLE, pinhole_views

from procam.estimate.boards.adjustment import BoardAdjustment
from procam.estimate.boards.corners import BoardRig, Corners, residuals, stack_corners
from procam.estimate.boards.left_out import best_model, clearly_better, held_out_residuals
from procam.estimate.boards.robust_fit import IDENTITY, BoardFit, fit_poses
from procam.estimate.boards.start import pose_from_rays
from procam.maths.geometry.lenses import Lens, unproject

BROWN, PLAIN = tuple(range(9)), tuple(range(4))
MODELS = tuple(BoardFit((free,), bend) for free in (PLAIN, BROWN) for bend in (False, True))


def fitted(rng: np.random.Generator, lens: Lens) -> tuple[Corners, BoardRig]:
    """Nine views of the bent board, and the fit of the richest model."""
    views = pinhole_views(rng, lens, 9)
    corners = stack_corners([v.points for v in views], [v.pixels[None] for v in views])
    boards = tuple(pose_from_rays(v.points, unproject(v.pixels, lens)) for v in views)
    start = BoardRig((lens,), (IDENTITY,), boards, BEND)
    return corners, MODELS[-1].adjustment(corners, start).solve(start)[0]


def test_residuals_of_a_fold_are_those_of_a_fit_without_it(rng) -> None:
    corners, rig = fitted(rng, PINHOLE)
    error = held_out_residuals(MODELS[-1], corners, rig, 3)
    test = [1, 4, 7]  # the second of three folds
    train = corners.only([v for v in range(9) if v not in test])
    without = BoardAdjustment(train, (BROWN,), np.array([1.0]), bend=True).solve(rig)[0]
    for view in test:
        alone = corners.only([view])
        expected = residuals(alone, fit_poses(alone, without))[0, corners.views[view]]
        np.testing.assert_allclose(error[0, corners.views[view]], expected, atol=1e-4)
    inside = np.sqrt(np.mean(residuals(corners, rig) ** 2))
    assert np.sqrt(np.mean(error**2)) > 1.01 * inside


@pytest.mark.parametrize("distorted", [False, True])
def test_the_model_that_predicts_best_is_chosen(rng, distorted: bool) -> None:
    lens = PINHOLE if distorted else Lens("brown", PINHOLE.focal, PINHOLE.centre, np.zeros(5))
    corners, rig = fitted(rng, lens)
    model, chosen = best_model(MODELS, corners, rig, 9)
    assert model == BoardFit((BROWN if distorted else PLAIN,), bend=True)
    assert chosen.lenses[0].distortion.any() == distorted
    np.testing.assert_allclose(chosen.bend, BEND, atol=1e-4)


def test_clearly_better_is_beyond_chance(rng) -> None:
    other = {str(i): rng.normal(0, 0.3, (50, 2)) for i in range(10)}
    assert clearly_better({name: 0.5 * error for name, error in other.items()}, other)
    assert not clearly_better(other, {name: 0.5 * error for name, error in other.items()})
    # better by too little to matter, though in every view
    assert not clearly_better({name: 0.97 * error for name, error in other.items()}, other)
    # better in one view only
    assert not clearly_better(other | {"3": 0.01 * other["3"]}, other)
    assert not clearly_better({"0": 0.01 * other["0"]}, other)
    # one view that the other cannot predict at all hides nothing
    assert clearly_better({n: 0.5 * e for n, e in other.items()}, other | {"3": 1e3 * other["3"]})
    assert not clearly_better({}, other)
