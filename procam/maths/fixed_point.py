"""Anderson's acceleration of a contraction (Walker and Ni 2011, doi:10.1137/10078356X)."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from procam.arrays import Array, Array32
from procam.errors import DidNotConverge

Light = TypeVar("Light", Array, Array32)
MEMORY = 5  # steps that the next one is found from
MOST = 100


def fixed_point(step: Callable[[Light], Light], start: Light, tolerance: float) -> Light:
    """The array x of the shape of `start` with step(x) = x, to `tolerance` of its largest value.

    Raises
    ------
    DidNotConverge
        If it is not reached in many steps.
    """
    place = start
    results: list[Light] = []
    residuals: list[Light] = []
    for _ in range(MOST):
        result = step(place)
        residual = result - place
        if np.abs(residual).max() <= tolerance * np.abs(result).max():
            return result
        results = results[-MEMORY:] + [result]  # noqa: RUF005 - mypy
        residuals = residuals[-MEMORY:] + [residual]  # noqa: RUF005
        place = _mixed(results, residuals)
    raise DidNotConverge(
        f"light between faces: not settled to {tolerance:g} after {MOST} steps, where 10 are usual; check "
        "that no albedo is close to 1"
    )


def _mixed(results: list[Light], residuals: list[Light]) -> Light:
    """The mean of results, with weights that sum to 1, whose mean residual is least."""
    if len(results) == 1:
        return results[0]
    steps = np.stack([(residuals[-1] - r).ravel() for r in residuals[:-1]], axis=1)
    weight = np.linalg.lstsq(steps, residuals[-1].ravel(), rcond=None)[0]
    moves = [results[-1] - r for r in results[:-1]]
    mixed: Light = results[-1] - sum(w * m for w, m in zip(weight, moves, strict=True))
    return mixed
