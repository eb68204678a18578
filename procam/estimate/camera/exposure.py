"""How long to expose, and what to expect of it, from one photograph of white and one of black.

Rates are signals above the black level per second [DN/s]. Noise is a law of the signal, read off
neighbouring pixels or off two photographs of the same picture.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_erosion, uniform_filter
from scipy.optimize import nnls

from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.camera.noise import NoiseLaw
from procam.maths.codes.phase import cramer_rao_variance, micro_waves
from procam.model.optics import Sensor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Counts = NDArray[Any]
TARGET_LEVEL = (
    0.92  # of full scale for the brightest lit pixel: the rest is for its noise and for drift
)
BRIGHT_QUANTILE, DARK_QUANTILE = (
    0.999,
    0.005,
)  # quantiles of the lit pixels: a few are glints, or lie under a seam
TARGET_SNR = 50.0
RATIO, MAX_RATIO, MAX_EXPOSURES = (
    4.0,
    8.0,
    3,
)  # a bracket: what one exposure clips, the next shows well
NEARLY = 1.1  # of an exposure: no picture is worth less than this
BLACK_SIGMAS = 20.0  # of read noise, that black light should stand above the black level
MAX_EXPOSURE_S = 60.0
LIT_SHARE = 0.3  # of white - black that comes straight, for a pixel to count as lit
CLEAR_SIGMAS = 6.0
LEVELS, ROUNDS = 16, 4
CUT_SIGMAS, CUT_MEAN = 3.0, 0.97334  # mean square of what a normal distribution has within
FEWEST_PIXELS = 50
ROUNDING = 1 / 12  # variance of a count's rounding [DN^2]
MAD_SIGMA = 1.4826


@dataclass(frozen=True, slots=True)
class ExposurePlan:
    """What to set, and what to expect.

    Attributes
    ----------
    exposure_s : keeps the brightest lit pixel just below saturation [s].
    bracket_s : exposures to merge (`hdr.merge_exposures`) for the darkest lit pixels to reach
        `TARGET_SNR`; one alone where it is enough [s].
    black_exposure_s : black light stands clear of read noise [s].
    snr, snr_bracket : (white - black) of the darkest lit pixel over its single-frame sigma, at
        `exposure_s` and after merging the bracket [-].
    column_sigma_px, column_sigma_darkest_px : Cramer-Rao bound of the default code's column error at
        `exposure_s`, for the median and the darkest lit pixel, without blur [projector px].
    lit_share : of the picture that is lit directly [-].
    peak : signal of the brightest lit pixel as photographed [full scale].
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
class _Light:
    """Rates (H, W) [DN/s] of white, black and direct light, and the lit pixels (H, W)."""

    white: Array
    black: Array
    direct: Array
    lit: Mask

    def inner(self) -> Mask:
        """Lit pixels (H, W) clear of any border."""
        inner = np.asarray(binary_erosion(self.lit, iterations=2))
        return inner if inner.any() else self.lit

    def darkest(self) -> tuple[float, float]:
        """Rates of white, and of white - black, where the latter is least."""
        inner = self.inner()
        white = uniform_filter(self.white, 3)[inner]  # else noise itself makes the darkest
        span = white - uniform_filter(self.black, 3)[inner]
        place = np.argpartition(span, int(DARK_QUANTILE * span.size))[
            int(DARK_QUANTILE * span.size)
        ]
        return float(white[place]), float(span[place])


def plan_exposures(
    white: Counts,
    black: Counts,
    *,
    exposures_s: tuple[float, float],
    sensor: Sensor,
    panel: tuple[int, int],
    direct: Counts | None = None,
    noise: NoiseLaw | None = None,
) -> ExposurePlan:
    """Exposures for one projector, from its white and black.

    Parameters
    ----------
    white, black : (H, W) or (H, W, 3) raw counts [DN]. exposures_s : theirs [s].
    sensor : bits and black level. panel : (width, height) of the projector [px].
    direct : (H, W) counts of white that came straight from the projector, 0 where not lit, as from
        `direct_light`; without it, from `lit_by_brightness`, all light there is taken for direct.
    noise : variance of a signal above black [DN^2]; read off the pictures if not given.

    Raises
    ------
    OutOfModelRange
        White is saturated. NotEnoughData : nothing is lit.
    """
    brightest = white.max(axis=2) if white.ndim == 3 else white
    noise = noise or noise_from_neighbours((green(white), green(black)), sensor)
    light = _light(green(white), green(black), exposures_s, sensor.black_level, direct)
    peak = float(np.quantile(brightest[light.lit], BRIGHT_QUANTILE)) - sensor.black_level
    if peak >= sensor.full_scale:
        raise OutOfModelRange(
            f"white: got {1 - BRIGHT_QUANTILE:.1%} or more of the lit pixels saturated at "
            f"{exposures_s[0]:g} s, expected less; try {0.25 * exposures_s[0]:.3g} s"
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


def meter(white: Counts, exposure_s: float, sensor: Sensor) -> float:
    """The exposure [s] at which the brightest of a photograph reach `TARGET_LEVEL`; a quarter if clipped.

    Looks at the 99.9 percentile of all pixels and channels; an exposure without signal is multiplied
    by no more than 16.
    """
    peak = float(np.quantile(white, BRIGHT_QUANTILE)) - sensor.black_level
    if peak >= sensor.full_scale:
        return 0.25 * exposure_s
    return exposure_s * min(16.0, TARGET_LEVEL * sensor.full_scale / max(peak, 1.0))


def green(counts: Counts) -> Counts:
    """The green channel (H, W) of counts (H, W) or (H, W, 3)."""
    return counts if counts.ndim == 2 else counts[..., 1]


def direct_light(first: Counts, second: Counts, span: Counts, noise_dn: ArrayLike) -> Array:
    """Light (H, W) that comes straight from the projector, from photographs of its two halves.

    `first` and `second` (H, W) show one half of the panel white each, `span` (H, W) is white - black,
    all at one exposure, and `noise_dn` the sigma there [DN]. Scattered light is the same in both, so
    their difference has none of it (as far as the halves carry the same flux). 0 where too little
    is direct.
    """
    direct = np.abs(np.asarray(first, float) - second)
    lit = (direct > LIT_SHARE * span) & (span > CLEAR_SIGMAS * np.asarray(noise_dn))
    return np.where(lit, np.minimum(direct, span), 0.0)


def lit_by_brightness(span: Counts, noise_dn: float) -> Mask:
    """Pixels (H, W) lit directly, from white - black (H, W) alone: the brighter of two groups.

    Scattered light reaches everywhere, so the groups are split where their logarithms differ most
    (Otsu 1979, doi:10.1109/TSMC.1979.4310076). Halves of the panel tell it better: `direct_light`.
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


def noise_from_neighbours(pictures: Sequence[Counts], sensor: Sensor) -> NoiseLaw:
    """Noise law from what photographs (H, W) of their own neighbourhood do not predict.

    Second differences along rows cancel slopes; texture of the screen counts as noise, so it is an
    upper bound. The law is of the signal above black [DN].
    """
    levels, squares = [], []
    for counts in pictures:
        value = np.asarray(counts, float) - sensor.black_level
        left, centre, right = value[:, :-2], value[:, 1:-1], value[:, 2:]
        sound = np.maximum(np.maximum(left, centre), right) < sensor.full_scale
        levels.append(((left + centre + right) / 3)[sound])
        squares.append(((left - 2 * centre + right) ** 2 / 6)[sound])
    return _noise_law(np.concatenate(levels), np.concatenate(squares))


def noise_from_repeat(first: Counts, second: Counts, sensor: Sensor) -> NoiseLaw:
    """Noise law from two photographs (H, W) of one picture; a common change of brightness is no noise."""
    a, b = (np.asarray(c, float) - sensor.black_level for c in (first, second))
    sound = np.maximum(a, b) < sensor.full_scale
    a, b = a[sound], b[sound]
    ratio = float(a @ b) / max(float(b @ b), 1e-9)
    return _noise_law(0.5 * (a + b), (a - ratio * b) ** 2 / (1 + ratio**2))


def merged_snr(pixel: tuple[float, float], noise: NoiseLaw, exposures_s: Sequence[float]) -> float:
    """Signal to noise of a pixel of rates (white, white - black) [DN/s] after merging exposures [s]."""
    white, span = pixel
    return float(np.sqrt(sum((span * e) ** 2 / noise.variance(white * e) for e in exposures_s)))


def exposure_for_snr(pixel: tuple[float, float], noise: NoiseLaw, snr: float) -> float:
    """Exposure [s] at which a pixel of rates (white, white - black) [DN/s] reaches a ratio alone."""
    white, span = pixel
    shot = snr**2 * noise.per_level * white
    return float((shot + np.sqrt(shot**2 + 4 * (snr * span) ** 2 * noise.floor)) / (2 * span**2))


def round_down_exposure(seconds: float) -> float:
    """Seconds to two or three figures, never more [s]."""
    unit = 10.0 ** (np.floor(np.log10(seconds)) - 2)
    return float(f"{np.floor(seconds / unit) * unit:.3g}")


def _light(
    white: Counts,
    black: Counts,
    exposures_s: tuple[float, float],
    level: float,
    direct: Counts | None,
) -> _Light:
    rate = (np.asarray(white, float) - level) / exposures_s[0]
    dark = (np.asarray(black, float) - level) / exposures_s[1]
    if direct is None:
        step = np.diff(rate, 2, axis=1)
        lit = lit_by_brightness(
            rate - dark, MAD_SIGMA * float(np.median(np.abs(step))) / np.sqrt(6)
        )
        straight = np.where(lit, rate - dark, 0.0)
    else:
        straight = np.asarray(direct, float) / exposures_s[0]
        lit = straight > 0
    if lit.sum() < FEWEST_PIXELS:
        raise NotEnoughData(
            f"white and black: got {lit.sum()} lit pixels, expected at least {FEWEST_PIXELS}; is the "
            "projector on, and does the camera see it?"
        )
    return _Light(rate, dark, straight, np.asarray(lit))


def _bracket(
    pixel: tuple[float, float], noise: NoiseLaw, exposure_s: float, ceiling_dn: float
) -> tuple[float, ...]:
    """Exposures [s] by equal ratios from `exposure_s` until the pixel reaches `TARGET_SNR`."""
    longest_s = min(exposure_for_snr(pixel, noise, TARGET_SNR), ceiling_dn / pixel[0])
    ratio = min(longest_s, MAX_EXPOSURE_S) / exposure_s
    if ratio <= NEARLY:
        return (exposure_s,)
    steps = min(MAX_EXPOSURES, 1 + math.ceil(math.log(ratio) / math.log(RATIO)))
    step = min(ratio ** (1 / (steps - 1)), MAX_RATIO)
    return (exposure_s, *(float(f"{exposure_s * step**k:.3g}") for k in range(1, steps)))


def _column_sigma(
    light: _Light, noise: NoiseLaw, exposure_s: float, panel: tuple[int, int]
) -> Array:
    """Cramer-Rao bound (n,) [px] for each inner pixel; its noise is that of half white."""
    waves, inner = micro_waves(panel), light.inner()
    x = np.linspace(0, 4 * waves.periods[0], 64)
    unit = cramer_rao_variance(waves, x, np.ones(64), np.ones(len(waves.periods))).mean()
    amplitude = 0.5 * exposure_s * light.direct[inner]
    level = 0.5 * exposure_s * (light.white + light.black)[inner]
    return np.asarray(np.sqrt(unit * noise.variance(level)) / amplitude)


def _black_exposure_s(
    light: _Light, noise: NoiseLaw, black_exposure_s: float, sensor: Sensor
) -> float:
    """Exposure [s] for black; light below a quarter count, as photographed, cannot be told."""
    # a mean, since whole counts have a coarse median
    rate = max(float(light.black[light.lit].mean()), 0.25 / black_exposure_s)
    most = max(float(np.quantile(light.black, BRIGHT_QUANTILE)), rate)
    wanted_s = BLACK_SIGMAS * float(np.sqrt(noise.variance(0.0))) / rate
    return float(f"{min(wanted_s, TARGET_LEVEL * sensor.full_scale / most, MAX_EXPOSURE_S):.3g}")


def _noise_law(level: Array, square: Array) -> NoiseLaw:
    """Line through the variance of samples sorted by level; neither part is negative.

    Edges and glints are not noise, so what lies beyond 3 sigma is left out.
    """
    order = np.argsort(level)
    parts = [p for p in np.array_split(order, LEVELS) if p.size]
    levels = np.array([level[p].mean() for p in parts])
    law = NoiseLaw(1.0, 0.0)
    for attempt in range(ROUNDS):  # within a part the variance grows too, as the law before it says
        share = square / law.variance(np.maximum(level, 0))
        means = [_robust_mean(share[p], coarse=attempt == 0) for p in parts]
        law = _line(levels, np.maximum(means * law.variance(np.maximum(levels, 0)), ROUNDING))
    return law


def _robust_mean(share: Array, coarse: bool) -> float:
    """Mean of squares about 1 without outliers; coarsely by the median, which whole counts distort."""
    if coarse:
        return MAD_SIGMA**2 * float(np.median(share))
    kept = share[share < CUT_SIGMAS**2]
    return float(kept.mean()) / CUT_MEAN if kept.size else 1.0


def _line(levels: Array, variances: Array) -> NoiseLaw:
    """The law that fits variances at levels best, in proportion; rounding is the least noise."""
    design = np.stack([np.ones(len(levels)), np.maximum(levels, 0)], axis=1)
    (floor, slope), _ = nnls(design / variances[:, None], np.ones(len(levels)))
    return NoiseLaw(max(float(floor), ROUNDING), float(slope))
