"""Whether a camera and a projector do what the solvers take for granted, from a few photographs."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Samples = NDArray[Any]


def fit_dark_frames(
    short: Samples, long: Samples, exposures_s: tuple[float, float]
) -> tuple[float, Array]:
    """Black level [DN], and room light with dark current (H, W) [DN/s], of two dark photographs.

    The line through both exposures [s], taken to exposure zero; its start is the median over pixels.
    """
    first, second = np.asarray(short, float), np.asarray(long, float)
    slope = (second - first) / (exposures_s[1] - exposures_s[0])
    # a mean would follow lamps in view, a median alone would fall on whole counts
    start = first - exposures_s[0] * slope
    low, high = np.quantile(start, [0.25, 0.75])
    return float(start[(start >= low) & (start <= high)].mean()), slope


def response_exponent(longer: Samples, shorter: Samples, ratio: float, usable: Mask) -> float:
    """How signals (H, W) [DN] grow with exposure: their ratio is `ratio` to this power; 1 is linear."""
    sound = usable & (shorter > 0) & (longer > 0)
    grown = float(np.median(np.asarray(longer[sound], float) / shorter[sound]))
    return float(np.log(grown) / np.log(ratio))


def additivity(parts: tuple[Samples, Samples], white: Samples, black: Samples, lit: Mask) -> float:
    """Light of two halves of the panel, shown one after the other, over that of white; 1 if they add.

    All (H, W), at one exposure [DN]. Black is in both halves, so it is taken off twice.
    """
    summed = np.asarray(parts[0], float) + parts[1] - 2.0 * black
    return float(np.median(summed[lit] / (np.asarray(white, float) - black)[lit]))


def grey_gamma(grey: Samples, white: Samples, black: Samples, lit: Mask, drive: float) -> float:
    """Exponent of the projector's response, from grey of a drive in 0..1 against white (H, W) [DN]."""
    share = (np.asarray(grey, float) - black)[lit] / (np.asarray(white, float) - black)[lit]
    return float(np.log(max(float(np.median(share)), 1e-6)) / np.log(drive))


def brightness_ratio(first: Samples, second: Samples, lit: Mask) -> float:
    """Brightness of the second photograph over the first, (H, W) signals [DN] of one picture."""
    return float(np.median(second[lit]) / max(float(np.median(first[lit])), 1.0))
