"""A veiling glare of 0 in venue.toml, compared with the darkest place that the camera sees.

No lens is without a veil, and no light trap gives exactly 0. The veil reaches every pixel, so there is no
more of it than light in the darkest place of a photograph, and nothing else bounds it.
"""

from dataclasses import replace

import numpy as np

from procam.arrays import BoolArray, Image
from procam.maths.warp import block_mean
from procam.model.optics import Sensor

UNMEASURED = 0.01  # standard error of a glare of 0 by somebody who does not know it
MOST = 0.05  # share of the light that a lens veils at most: by ISO 9358 good ones 0.5 to 3 %
CELL_PX = 4  # edge of the cells whose light is compared, to average noise
DARKEST = 0.01  # quantile of the cells
UNIFORM = 3**-0.5  # standard error of a value between 0 and 1, about 0
WIDER = 2.0  # times the stated standard error: less is no contradiction


def darkest_share(light: Image, seen: BoolArray) -> float:
    """Light (H, W) in the darkest place of the image circle over the mean; at least 0, and noise."""
    whole = block_mean(seen.astype(np.float32), CELL_PX) == 1
    cells = block_mean(np.nan_to_num(light), CELL_PX)[whole]
    mean = float(np.nan_to_num(light)[seen].mean()) if seen.any() else 0.0
    if not (cells.size and mean > 0):
        return MOST
    return max(0.0, float(np.quantile(cells, DARKEST)) / mean)


def bounded_glare(sensor: Sensor, darkest: float) -> Sensor:
    """The sensor, with a wider standard error of a glare of 0 if light in the darkest place allows more.

    Parameters
    ----------
    darkest : `darkest_share` of a photograph; the least of several.
    """
    bound = UNIFORM * min(darkest, MOST)
    stated = sensor.glare_sigma
    if sensor.glare > 0 or stated >= UNMEASURED or bound <= WIDER * stated:
        return sensor
    return replace(sensor, glare_sigma=bound)


def glare_notes(camera: str, stated: Sensor, bounded: Sensor, darkest: float) -> list[str]:
    """A note if the standard error of the glare was not trusted."""
    if bounded.glare_sigma == stated.glare_sigma:
        return []
    return [
        f"camera {camera}: venue.toml has glare = 0 with glare_sigma = {stated.glare_sigma:g}, but no "
        f"lens is without a veil, and the darkest place in its pictures has {darkest:.1%} of their mean "
        f"light; m and albedo may be too large, and their standard errors are by glare_sigma = "
        f"{bounded.glare_sigma:.2g}. Measure it with `procam lens glare`"
    ]
