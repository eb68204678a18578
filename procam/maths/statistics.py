"""Estimates of scatter that a few outliers do not change."""

import numpy as np

from procam.arrays import FloatArray

NORMAL_MAD = 1.4826  # sigma of a normal distribution over its median absolute deviation
MEDIAN_SIGMA = 1.2533  # standard error of a normal sample's median over that of its mean
RAYLEIGH_MEDIAN = 1.1774  # median length of a 2-D normal vector of unit sigma per axis


def robust_sigma(values: FloatArray, centre: float | None = None) -> float:
    """Standard deviation of values (...,) from their median absolute deviation.

    `centre` is what they scatter about, the median if not given.

    >>> robust_sigma(np.array([-1.0, 0.0, 1.0, 900.0, -900.0]))
    1.4826
    """
    if centre is None:
        centre = float(np.median(values))
    return NORMAL_MAD * float(np.median(np.abs(values - centre)))


def robust_sigma_2d(lengths: FloatArray) -> float:
    """Standard deviation per axis of 2-D residuals of these lengths (N,), from their median."""
    return float(np.median(lengths)) / RAYLEIGH_MEDIAN
