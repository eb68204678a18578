"""Robust statistics of normal samples with outliers."""

import numpy as np
import pytest
from tolerances import SIGMAS

from procam.maths.statistics import robust_sigma, robust_sigma_2d

COUNT = 100_000
# relative standard error of a median absolute deviation, sqrt(1.36 / N)
ERROR = SIGMAS * np.sqrt(1.36 / COUNT)


def test_sigma_of_normal_samples(rng: np.random.Generator) -> None:
    values = rng.normal(7.0, 0.3, COUNT)
    assert robust_sigma(values) == pytest.approx(0.3, rel=ERROR)
    assert robust_sigma(values - 7.0, 0.0) == pytest.approx(0.3, rel=ERROR)
    values[: COUNT // 100] = 1e6
    assert robust_sigma(values) == pytest.approx(0.3, rel=0.03)


def test_a_centre_elsewhere_counts() -> None:
    assert robust_sigma(np.full(5, 2.0), 0.0) == pytest.approx(2 * robust_sigma(np.ones(5), 0.0))
    assert robust_sigma(np.full(5, 2.0)) == 0


def test_sigma_of_lengths(rng: np.random.Generator) -> None:
    lengths = np.linalg.norm(rng.normal(0, 0.3, (COUNT, 2)), axis=1)
    assert robust_sigma_2d(lengths) == pytest.approx(0.3, rel=ERROR)
