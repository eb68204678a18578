"""The Levenberg-Marquardt iteration, for problems that solve their own normal equations.

A problem gives the cost of a state and, from its normal equations at a state, the trial state for a
damping. The driver takes trials that do not raise the cost, and raises the damping until one is found
(Marquardt 1963, doi:10.1137/0111030). The state may be anything, so that poses move on their own
manifold, and a problem may eliminate its many local unknowns before it solves for the few shared ones.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

State = TypeVar("State")
Trial = Callable[[float], State]

FIRST_DAMPING, MIN_DAMPING, MAX_DAMPING = 1e-4, 1e-12, 1e12  # shares of the diagonal
LEAST_GAIN = 1e-11  # of a step, relative: below, the descent ends
RAISE, LOWER = 8.0, 64.0  # a successful step lowers the damping by LOWER / RAISE


def minimise(
    state: State,
    cost: Callable[[State], float],
    linearise: Callable[[State], Trial[State]],
    *,
    iterations: int = 200,
) -> tuple[State, bool]:
    """Descend from a state to the nearest minimum of a cost.

    Parameters
    ----------
    cost : the value to minimise; infinite or NaN where a state is impossible.
    linearise : builds the normal equations at a state; returns the function from damping to trial state.
    iterations : most linearisations.

    Returns
    -------
    state, converged : where the descent ended, and whether it ended before `iterations`.
    """
    value, damping = cost(state), FIRST_DAMPING
    for _ in range(iterations if np.isfinite(value) else 0):
        trial_at = linearise(state)
        trial, new = state, np.inf
        while not new <= value:
            if damping > MAX_DAMPING:  # rounding allows no lower cost
                return state, True
            trial = trial_at(damping)
            new = cost(trial)
            damping *= RAISE
        gain = (value - new) / max(value, 1e-30)
        state, value, damping = trial, new, max(damping / LOWER, MIN_DAMPING)
        if gain < LEAST_GAIN:
            return state, True
    return state, False
