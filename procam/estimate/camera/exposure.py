"""Exposures for a projector and the precision to expect, from one photograph of white and one of black.

Rates are signals above the black level per second [DN/s]. The brightest lit pixels set the exposure,
the signal-to-noise ratio of the darkest sets the bracket. Noise follows `NoiseLaw`, and the expected
column error is the Cramer-Rao bound of the default code.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import binary_erosion, uniform_filter

from procam.arrays import AnyArray, Array, BoolArray
from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.camera.noise import NoiseLaw, noise_from_neighbours
from procam.maths.codes.phase import cramer_rao_variance, micro_waves
from procam.maths.statistics import robust_sigma
from procam.model.optics import Sensor

TARGET_LEVEL = 0.92  # of full scale for the brightest lit pixels; leaves room for noise and drift
BRIGHT_QUANTILE, DARK_QUANTILE = 0.999, 0.005  # of the lit pixels; excludes glints and seams
TARGET_SNR = 50.0  # of the darkest lit pixel
RATIO, MAX_RATIO, MAX_EXPOSURES = 4.0, 8.0, 3  # of a bracket: usual and largest ratio, number
WORTHWHILE = 1.1  # smallest ratio of exposures that justifies another picture
BLACK_SIGMAS = 20.0  # of read noise, by which the black picture's light exceeds the black level
MAX_EXPOSURE_S = 60.0
LIT_SHARE = 0.3  # of white - black that is direct light, for a pixel to count as lit
CLEAR_SIGMAS = 6.0  # of noise, for white - black to count as light
MIN_PIXELS = 50
MIN_BLACK_COUNTS = 0.25  # black light below this is lost in the rounding [DN]


@dataclass(frozen=True, slots=True)
class ExposurePlan:
    """Exposures to set and the precision to expect.

    Attributes
    ----------
    exposure_s : the brightest lit pixels stay just below saturation [s].
    bracket_s : exposures to merge (`hdr.merge_exposures`) so that the darkest lit pixels reach
        `TARGET_SNR`; one where it suffices [s].
    black_exposure_s : the light of a black picture exceeds the read noise [s].
    snr, snr_bracket : (white - black) of the darkest lit pixel over its single-frame sigma, at
        `exposure_s` and after merging the bracket [-].
    column_sigma_px, column_sigma_darkest_px : Cramer-Rao bound of the default code's column error at
        `exposure_s`, for the median and the darkest lit pixel, without blur [projector px].
    lit_share : directly lit share of the picture [-].
    peak : signal of the brightest lit pixel in the white photograph [full scale].
    """

    exposure_s: float
    bracket_s: tuple[float, ...]
    black_exposure_s: float
    snr: float
    snr_bracket: float
    column_sigma_px: float
    column_sigma_darkest_px: float
    lit_share: float
    peak: float


@dataclass(frozen=True, slots=True)
class _WhiteAndBlack:
    """Rates (H, W) [DN/s] of white, black and direct light, and the lit pixels (H, W)."""

    white: Array
    black: Array
    direct: Array
    lit: BoolArray

    def inner(self) -> BoolArray:
        """Lit pixels (H, W) clear of any border."""
        inner = np.asarray(binary_erosion(self.lit, iterations=2))
        return inner if inner.any() else self.lit

    def darkest(self) -> tuple[float, float]:
        """Rates of white and of white - black at the darkest lit pixel."""
        inner = self.inner()
        white = uniform_filter(self.white, 3)[
            inner
        ]  # smooth: the noisiest pixel is not the darkest
        span = white - uniform_filter(self.black, 3)[inner]
        place = np.argpartition(span, int(DARK_QUANTILE * span.size))[
            int(DARK_QUANTILE * span.size)
        ]
        return float(white[place]), float(span[place])


def plan_exposures(
    white: AnyArray,
    black: AnyArray,
    *,
    exposures_s: tuple[float, float],
    sensor: Sensor,
    panel: tuple[int, int],
    direct: AnyArray | None = None,
    noise: NoiseLaw | None = None,
) -> ExposurePlan:
    """Plan the exposures of one camera for one projector.

    Parameters
    ----------
    white, black : (H, W) or (H, W, 3) raw counts [DN]. exposures_s : theirs [s].
    sensor : bits and black level. panel : (width, height) of the projector [px].
    direct : (H, W) counts of white that are direct light, 0 where not lit, as from `direct_light`.
        Without it all light of the pixels of `lit_by_brightness` counts as direct.
    noise : variance of a signal above black [DN^2]; estimated from the pictures if not given.

    Raises
    ------
    OutOfModelRange
        White is saturated.
    NotEnoughData
        No pixel is lit.
    """
    brightest = white.max(axis=2) if white.ndim == 3 else white
    noise = noise or noise_from_neighbours((green(white), green(black)), sensor)
    light = _light(green(white), green(black), exposures_s, sensor.black_level, direct)
    peak = float(np.quantile(brightest[light.lit], BRIGHT_QUANTILE)) - sensor.black_level
    if peak >= sensor.full_scale:
        raise OutOfModelRange(
            f"white: {1 - BRIGHT_QUANTILE:.1%} or more of the lit pixels are saturated at "
            f"{exposures_s[0]:g} s; try {0.25 * exposures_s[0]:.3g} s"
        )
    exposure_s = round_down_exposure(TARGET_LEVEL * sensor.full_scale / peak * exposures_s[0])
    bracket_s = _bracket(light.darkest(), noise, exposure_s, TARGET_LEVEL * sensor.full_scale)
    sigma = _column_sigma(light, noise, exposure_s, panel)
    return ExposurePlan(
        exposure_s,
        bracket_s,
        _black_exposure_s(light, noise, exposures_s[1], sensor),
        merged_snr(light.darkest(), noise, (exposure_s,)),
        merged_snr(light.darkest(), noise, bracket_s),
        float(np.median(sigma)),
        float(np.quantile(sigma, 1 - DARK_QUANTILE)),
        float(light.lit.mean()),
        peak / sensor.full_scale,
    )


def meter(white: AnyArray, exposure_s: float, sensor: Sensor) -> float:
    """The exposure [s] at which the 99.9 percentile of a photograph reaches `TARGET_LEVEL`.

    All pixels and channels count. A clipped photograph gives a quarter of its exposure; one without
    signal gives 16 times its exposure at most.
    """
    peak = float(np.quantile(white, BRIGHT_QUANTILE)) - sensor.black_level
    if peak >= sensor.full_scale:
        return 0.25 * exposure_s
    return exposure_s * min(16.0, TARGET_LEVEL * sensor.full_scale / max(peak, 1.0))


def green(counts: AnyArray) -> AnyArray:
    """The green channel (H, W) of counts (H, W) or (H, W, 3)."""
    return counts if counts.ndim == 2 else counts[..., 1]


def direct_light(first: AnyArray, second: AnyArray, span: AnyArray, noise_dn: ArrayLike) -> Array:
    """Direct light (H, W) [DN] from photographs of the panel's two halves; 0 where not lit.

    `first` and `second` (H, W) show one half of the panel white each, `span` (H, W) is white - black,
    all at one exposure; `noise_dn` is the sigma of `span` [DN]. Scattered light is equal in both
    photographs, as far as the halves carry equal flux, so it cancels in their difference.
    """
    direct = np.abs(np.asarray(first, float) - second)
    lit = (direct > LIT_SHARE * span) & (span > CLEAR_SIGMAS * np.asarray(noise_dn))
    return np.where(lit, np.minimum(direct, span), 0.0)


def lit_by_brightness(span: AnyArray, noise_dn: float) -> BoolArray:
    """Directly lit pixels (H, W) from white - black (H, W) alone: the brighter of two groups.

    Scattered light reaches every pixel, so the threshold is where the logarithms of the two groups
    differ most (Otsu 1979, doi:10.1109/TSMC.1979.4310076). `direct_light` is more reliable.
    """
    clear = span > CLEAR_SIGMAS * noise_dn
    if not clear.any():
        return np.asarray(clear)
    weight, edges = np.histogram(np.log(span[clear]), 128)
    middle = 0.5 * (edges[1:] + edges[:-1])
    below = np.cumsum(weight)[:-1]
    above = below[-1] + weight[-1] - below
    moment = np.cumsum(weight * middle)
    apart = moment[:-1] / np.maximum(below, 1) - (moment[-1] - moment[:-1]) / np.maximum(above, 1)
    return np.asarray(clear & (span > np.exp(edges[1 + np.argmax(below * above * apart**2)])))


def merged_snr(pixel: tuple[float, float], noise: NoiseLaw, exposures_s: Sequence[float]) -> float:
    """Signal-to-noise ratio of a pixel of rates (white, white - black) [DN/s] in merged exposures [s]."""
    white, span = pixel
    return float(np.sqrt(sum((span * e) ** 2 / noise.variance(white * e) for e in exposures_s)))


def exposure_for_snr(pixel: tuple[float, float], noise: NoiseLaw, snr: float) -> float:
    """Single exposure [s] at which a pixel of rates (white, white - black) [DN/s] reaches `snr`."""
    white, span = pixel
    shot = snr**2 * noise.per_level * white
    return float((shot + np.sqrt(shot**2 + 4 * (snr * span) ** 2 * noise.floor)) / (2 * span**2))


def round_down_exposure(seconds: float) -> float:
    """An exposure [s] rounded down to three significant figures."""
    unit = 10.0 ** (np.floor(np.log10(seconds)) - 2)
    return float(f"{np.floor(seconds / unit) * unit:.3g}")


def _light(
    white: AnyArray,
    black: AnyArray,
    exposures_s: tuple[float, float],
    level: float,
    direct: AnyArray | None,
) -> _WhiteAndBlack:
    rate = (np.asarray(white, float) - level) / exposures_s[0]
    dark = (np.asarray(black, float) - level) / exposures_s[1]
    if direct is None:
        step = np.diff(rate, 2, axis=1)
        lit = lit_by_brightness(rate - dark, robust_sigma(step, 0.0) / np.sqrt(6))
        direct_rate = np.where(lit, rate - dark, 0.0)
    else:
        direct_rate = np.asarray(direct, float) / exposures_s[0]
        lit = direct_rate > 0
    if lit.sum() < MIN_PIXELS:
        raise NotEnoughData(
            f"white and black: only {lit.sum()} pixels are lit; at least {MIN_PIXELS} are needed. Check that "
            "the projector is on and in the camera's view"
        )
    return _WhiteAndBlack(rate, dark, direct_rate, np.asarray(lit))


def _bracket(
    pixel: tuple[float, float], noise: NoiseLaw, exposure_s: float, ceiling_dn: float
) -> tuple[float, ...]:
    """Exposures [s] in equal ratios from `exposure_s` until the pixel reaches `TARGET_SNR`."""
    longest_s = min(exposure_for_snr(pixel, noise, TARGET_SNR), ceiling_dn / pixel[0])
    ratio = min(longest_s, MAX_EXPOSURE_S) / exposure_s
    if ratio <= WORTHWHILE:
        return (exposure_s,)
    steps = min(MAX_EXPOSURES, 1 + math.ceil(math.log(ratio) / math.log(RATIO)))
    step = min(ratio ** (1 / (steps - 1)), MAX_RATIO)
    return (exposure_s, *(float(f"{exposure_s * step**k:.3g}") for k in range(1, steps)))


def _column_sigma(
    light: _WhiteAndBlack, noise: NoiseLaw, exposure_s: float, panel: tuple[int, int]
) -> Array:
    """Cramer-Rao bound (n,) [px] of the column at each inner pixel, with the noise of half white."""
    waves, inner = micro_waves(panel), light.inner()
    x = np.linspace(0, 4 * waves.periods[0], 64)
    unit = cramer_rao_variance(waves, x, np.ones(64), np.ones(len(waves.periods))).mean()
    amplitude = 0.5 * exposure_s * light.direct[inner]
    level = 0.5 * exposure_s * (light.white + light.black)[inner]
    return np.asarray(np.sqrt(unit * noise.variance(level)) / amplitude)


def _black_exposure_s(
    light: _WhiteAndBlack, noise: NoiseLaw, black_exposure_s: float, sensor: Sensor
) -> float:
    """Exposure [s] for the black picture."""
    # the mean, since the median of whole counts is coarse
    rate = max(float(light.black[light.lit].mean()), MIN_BLACK_COUNTS / black_exposure_s)
    most = max(float(np.quantile(light.black, BRIGHT_QUANTILE)), rate)
    wanted_s = BLACK_SIGMAS * float(np.sqrt(noise.variance(0.0))) / rate
    return float(f"{min(wanted_s, TARGET_LEVEL * sensor.full_scale / most, MAX_EXPOSURE_S):.3g}")
