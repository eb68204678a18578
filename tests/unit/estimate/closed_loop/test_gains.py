"""Gains that the closed loop learns from light that was received beyond what was asked."""

import numpy as np
import pytest

from procam.estimate.closed_loop.gains import MIN_CELLS, gain_change

CELLS = 4000


def _learnt(surplus: np.ndarray, asked: np.ndarray, sigma: float) -> np.ndarray:
    every = np.ones((len(asked), 1), bool)
    noise = np.full((len(asked), 1), sigma)
    return gain_change(surplus[:, None], asked[:, None], noise, every)[:, 0]


def test_gains_that_vary_more_than_the_noise_are_learnt(rng: np.random.Generator) -> None:
    asked, truth = np.full(CELLS, 0.4), rng.normal(0.03, 0.05, CELLS)
    seen = truth * asked + rng.normal(0, 0.002, CELLS)
    left = _learnt(seen, asked, 0.002) - truth
    assert abs(left.mean()) < 1e-3
    assert left.std() == pytest.approx(0.002 / 0.4, rel=0.1)


def test_noise_is_not_learnt(rng: np.random.Generator) -> None:
    asked = rng.uniform(0.05, 0.5, CELLS)
    change = _learnt(rng.normal(0, 0.01, CELLS), asked, 0.01)
    assert change.std() < 0.15 * np.std(0.01 / asked)


def test_light_that_no_gain_explains_is_not_a_gain_of_dark_cells(rng: np.random.Generator) -> None:
    """A veil of 0.05 % of white is a hundredth of the light of a dark cell."""
    asked = np.where(np.arange(CELLS) % 2 == 0, 0.05, 0.8)
    truth = rng.normal(0, 0.02, CELLS)
    veil = np.where(asked < 0.1, 5e-4, 0.0)
    learnt = _learnt(truth * asked + veil, asked, 1e-4)
    dark = asked < 0.1
    assert (learnt - truth)[~dark].std() < 0.002
    assert np.sqrt(np.mean((learnt - truth)[dark] ** 2)) < np.sqrt(
        np.mean((truth + 0.01)[dark] ** 2)
    )
    assert np.corrcoef(learnt[dark], truth[dark])[0, 1] > 0.9
    assert np.median(learnt[dark] / (truth[dark] + 0.01)) < 0.8  # shrunk where it is uncertain


def test_the_level_of_one_picture_is_not_trusted_to_a_thousandth() -> None:
    """Levels differ by about 0.2 % between pictures; a lamp that aged changes more."""
    asked = np.full(CELLS, 0.4)
    np.testing.assert_allclose(_learnt(0.001 * asked, asked, 1e-4), 0.0002, rtol=0.01)
    np.testing.assert_allclose(_learnt(-0.05 * asked, asked, 1e-4), -0.05, rtol=0.01)


def test_unknown_unlit_and_too_few_cells_keep_their_gains() -> None:
    asked, surplus = np.full((CELLS, 2), 0.4), np.full((CELLS, 2), 0.02)
    asked[:10, 0] = 0
    known = np.ones((CELLS, 2), bool)
    known[10:20, 0] = False
    known[MIN_CELLS - 1 :, 1] = False
    change = gain_change(surplus, asked, np.full((CELLS, 2), 1e-3), known)
    assert (change[:20, 0] == 0).all() and (change[20:, 0] > 0.04).all()
    assert (change[:, 1] == 0).all()
