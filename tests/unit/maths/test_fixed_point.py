"""Anderson's acceleration."""

import numpy as np
import pytest

from procam.errors import DidNotConverge
from procam.maths.fixed_point import fixed_point


def test_a_linear_contraction_takes_few_steps(rng: np.random.Generator) -> None:
    spread = np.diag([0.7, 0.5, -0.6, 0.1])
    offset, count = rng.normal(size=4), 0

    def step(x: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        return spread @ x + offset

    found = fixed_point(step, np.zeros(4), 1e-12)
    np.testing.assert_allclose(found, np.linalg.solve(np.eye(4) - spread, offset), atol=1e-11)
    assert count < 10  # 75 without acceleration


def test_with_a_clip() -> None:
    found = fixed_point(lambda x: np.clip(1.0 - 0.8 * x[::-1], 0.5, 0.7), np.zeros(2), 1e-12)
    np.testing.assert_allclose(found, 1.0 - 0.8 * found[::-1], atol=1e-11)


def test_what_does_not_settle_is_an_error() -> None:
    with pytest.raises(DidNotConverge, match="no albedo is close to 1"):
        fixed_point(lambda x: x + 1, np.zeros(3), 1e-6)
