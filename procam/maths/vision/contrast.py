"""Sensitivity to contrast, opponent channels and masking, as ColorVideoVDP has them.

Constants are those of ColorVideoVDP 0.5.7 (MIT licence, text beside the table): Mantiuk et al. (2024),
"ColorVideoVDP: A visual difference predictor for image, video and display distortions"
(doi:10.1145/3658144), and the sensitivity of Ashraf et al. (2024), "castleCSF" (doi:10.1167/jov.24.4.5).
"""

from functools import cache
from importlib.resources import files

import numpy as np
from scipy.ndimage import map_coordinates

from procam.arrays import AnyArray, Array

#: opponent channels (achromatic, red-green, violet-yellow) of linear sRGB
DKL_FROM_LMS = np.array([[1, 1, 0], [1, -2.311130179947035, 0], [-1, -1, 50.977571328718781]])
LMS_FROM_XYZ = np.array(
    [
        [0.187596268556126, 0.585168649077728, -0.026384263306304],
        [-0.133397430663221, 0.405505777260049, 0.034502127690364],
        [0.000244379021663, -0.000542995890619, 0.019406849066323],
    ]
)
XYZ_FROM_RGB = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
DKL_FROM_RGB = DKL_FROM_LMS @ LMS_FROM_XYZ @ XYZ_FROM_RGB
GAINS = np.array([1.0, 1.45, 1.0])  # of the opponent channels
CORRECTION = 10 ** (-0.2797423303127289 / 20)
MASKING = 10**-0.7954971194267273 / 2  # half of ColorVideoVDP's: 0.08
EXPONENTS = np.array([1.302622675895691, 2.8885908126831055, 3.6807713508605957])
#: (3, 3) masking of the column's channel by the row's
CROSS_CHANNEL = 2.0 ** np.array(
    [
        [-0.18950104713439941, -5.962151050567627, -4.31834602355957],
        [2.5655593872070312, 0.34406712651252747, -2.719646453857422],
        [3.8118371963500977, -1.0051705837249756, -0.5193376541137695],
    ]
)
STORED = "castle_csf.npz"


def sensitivity(channel: int, cycles_per_degree: float, nits: AnyArray) -> Array:
    """Contrast sensitivity of an opponent channel to gratings that stand still, on luminance [cd/m2]."""
    nits_of, frequency_of, table = _table()
    row = _position(np.asarray(nits, float), nits_of)
    column = _position(np.array(cycles_per_degree), frequency_of)
    at = [row, np.broadcast_to(column, row.shape)]
    log = map_coordinates(table[channel], at, order=1, mode="nearest")
    return np.asarray(CORRECTION * 10.0**log)


def _position(value: Array, of: Array) -> Array:
    """Where values lie among logarithmic steps."""
    low, high = np.log10(of[0]), np.log10(of[-1])
    share = (np.log10(np.clip(value, of[0], of[-1])) - low) / (high - low)
    return np.asarray(share * (len(of) - 1))


@cache
def _table() -> tuple[Array, Array, Array]:
    with files("procam.maths.vision").joinpath(STORED).open("rb") as file, np.load(file) as stored:
        names = ("luminance", "frequency", "log_sensitivity")
        nits, frequency, table = (stored[name].astype(float) for name in names)
    return nits, frequency, table
