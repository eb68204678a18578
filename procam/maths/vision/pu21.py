"""PU21: luminance on a scale on which equal steps are about equally visible.

Mantiuk, R. and Azimi, M. (2021), "PU21: A novel perceptually uniform encoding for adapting existing quality
metrics for HDR" (doi:10.1109/PCS50896.2021.9477471), the curve "banding and glare".
"""

from functools import cache

import numpy as np

from procam.arrays import AnyArray, Array
from procam.maths.log_table import LogTable

P = (
    *(0.353487901, 0.3734658629, 8.277049286e-05, 0.9062562627),
    *(0.09150303166, 0.9099517204, 596.3148142),
)
DARKEST, BRIGHTEST = 0.005, 1e4  # cd/m2, what the curve was fitted to


def pu21(nits: AnyArray) -> Array:
    """PU21 units of luminance [cd/m2], which is clipped to 0.005..10,000.

    >>> pu21(np.array([0.005, 1.0, 100.0])).round(1).tolist()
    [0.0, 36.5, 256.4]
    """
    return _curve(np.clip(np.asarray(nits, float), DARKEST, BRIGHTEST))


@cache
def pu21_table() -> LogTable:
    """The same with its slope, right to 6e-4 units."""
    return LogTable(_curve, DARKEST, BRIGHTEST)


def _curve(nits: Array) -> Array:
    power = nits ** P[3]
    share = (P[0] + P[1] * power) / (1 + P[2] * power)
    return np.asarray(np.maximum(P[6] * (share ** P[4] - P[5]), 0))
