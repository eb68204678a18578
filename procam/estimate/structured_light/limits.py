"""Limits of a decoder: which light, which bits and which samples count."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import AnyArray, Array32, BoolArray, Map
from procam.estimate.camera.noise import NoiseLaw
from procam.maths.statistics import robust_sigma
from procam.model.optics import Sensor

LIT_SHARE = 0.1
WHITE_SIGMAS, CONTRAST_SIGMAS = 5.0, 4.0  # of a difference of two samples, by a known noise law
BEYOND_SHARE = 0.03  # of pixels whose stripes are certain: misread ones at edges are fewer
WAVES_BEYOND_SHARE = 0.15  # where waves alone are judged, edges and mixtures give 0.08
WAVES_BEYOND_MOST = 0.3  # a set with more is refused: a wrong sign of all shifts gives 0.37


@dataclass(frozen=True, slots=True)
class DecodeLimits:
    """Which pixels and samples a decoder accepts, in the unit of the photographs.

    Attributes
    ----------
    white_black : white - black must exceed this; one for all pixels, or (H, W).
    contrast : |pattern - inverse| must reach this in every pair of stripes; one for all pixels, or (H, W).
    lit_share : direct light must be this share of white - black. Scattered light reaches the whole
        dome, so white - black alone would accept all of it (docs/theory/interreflection.md). 0 means
        that there is no scattered light.
    saturated, dark : samples at or above, at or below, are not used; None for no limit.
    neighbours : a pixel must agree with its neighbourhood, or it is dropped.
    """

    white_black: float | Map
    contrast: float | Map
    lit_share: float = LIT_SHARE
    saturated: float | None = None
    dark: float | None = None
    neighbours: bool = True


def default_limits(white: AnyArray, black: AnyArray) -> DecodeLimits:
    """Limits for photographs (H, W) of an unknown camera, from their own noise.

    The noise is estimated from the differences of neighbouring pixels in black. The contrast of a bit
    must reach 4 standard deviations of it, white - black 8. Samples of whole numbers are saturated
    at full scale and dark at 0.
    """
    step = np.diff(black.astype(float), axis=1)
    noise = robust_sigma(step) / np.sqrt(2)
    steps = np.diff(np.unique([white, black]))
    # a photograph that can be decoded spans 16 camera steps or more; a drawing has two values only
    rounding = 0.5 * min(float(steps.min()), float(steps.sum()) / 16) if steps.size else 0.5
    noise = max(noise, rounding)
    whole = white.dtype.kind == "u"
    return DecodeLimits(
        white_black=8 * noise,
        contrast=4 * noise,
        saturated=full_scale(white) if whole else None,
        dark=0.0 if whole else None,
    )


def limits_by_noise(
    white: AnyArray, black: AnyArray, law: NoiseLaw, sensor: Sensor
) -> DecodeLimits:
    """Limits for counts (H, W) of a camera whose noise law is known, pixel by pixel."""
    sigma = difference_sigma(white, black, law, sensor)
    return DecodeLimits(
        WHITE_SIGMAS * sigma, CONTRAST_SIGMAS * sigma, saturated=2.0**sensor.bits - 1
    )


def difference_sigma(white: AnyArray, black: AnyArray, law: NoiseLaw, sensor: Sensor) -> Array32:
    """Standard error (H, W) of white - black, or of a pattern - its inverse [DN]."""
    dark = np.float32(sensor.black_level)
    levels = (
        np.maximum(np.subtract(counts, dark, dtype=np.float32), 0) for counts in (white, black)
    )
    first, second = (law.variance(level) for level in levels)
    return np.asarray(np.sqrt(first + second), np.float32)


def full_scale(white: AnyArray) -> float:
    """Full scale of whole numbers: of the fewest bits, of 8, 10, 12, 14 or 16, that hold `white`."""
    top = int(white.max())
    return float(next(2**bits - 1 for bits in (8, 10, 12, 14, 16) if top < 2**bits))


def dropped_samples(image: AnyArray, limits: DecodeLimits) -> BoolArray:
    """Samples (H, W) that cannot be used: saturated, dark, or not a number."""
    bad = ~np.isfinite(image) if image.dtype.kind == "f" else np.zeros(image.shape, bool)
    if limits.saturated is not None:
        bad |= image >= limits.saturated
    if limits.dark is not None:
        bad |= image <= limits.dark
    return np.asarray(bad)


def beyond_panel(share: float, length: int, most: float) -> str:
    """What is wrong if more than `most` of the pixels fit no column or row of a panel; else empty."""
    if share <= most:
        return ""
    return (
        f"{share:.0%} of the pixels with light show patterns that a panel of {length} does not have; check "
        "the size, whether width and height are exchanged, and the sign of shifts"
    )
