"""Checks, from a few photographs, of what the solvers assume about a camera and a projector, and of focus."""

import numpy as np
from scipy.ndimage import maximum_filter, uniform_filter

from procam.arrays import AnyArray, Array, BoolArray, FloatArray, Image, IndexArray

PLATEAU_PIXELS = 50  # at the highest level; fewer are specks
# times as many as at the level below it: noise makes the number fall towards the top
PLATEAU_CLEAR = 3
BAND = 256  # rows
LEVEL_SHARES = 1e-3, 3e-3  # of full scale: widths of a level, in which pixels saturate
DIM_BRIGHT, DIM_DARK = 0.5, 0.25  # of the bright level: pixels to compare exposures by
DIM_PIXELS, DIM_SIGMAS = 100, 20.0  # of them; of noise, by which the shorter photograph shows them
AROUND, NEAR = 7, 3  # pixels
BRIGHT_SHARE = 0.2  # of full scale: a darker top is no end of a camera's range
LIT_SHARE = 0.2  # of the bright level of white, from which pixels count
NOT_WHITE = 0.7  # scattered light counts twice in the sum
REACH_PX = 12  # within which an edge has full contrast on both sides
LEAST_CONTRAST = 0.3  # of the usual one, on both sides
NEAR_EDGE = 0.4  # of full contrast: pixels so close to the middle of an edge
STEEPEST, FLAT = (
    0.98,
    0.2,
)  # quantile, and share of it below which there is no edge but scattered light
MIN_PIXELS = 50  # near edges


def early_clipping(counts: AnyArray, full: int) -> tuple[int, float] | None:
    """Level [DN] below `full` at which a bright photograph (H, W[, C]) ends, and share of its pixels there.

    None if none of its channels does. Where light ends, noise makes the highest level the rarest; where a
    camera clips, as by a limited range or a highlight mode, it is the most frequent of the upper ones.
    """
    for channel in np.moveaxis(np.atleast_3d(counts), -1, 0):
        number = _histogram(channel, full)
        top = len(number) - 1
        for width in (max(1, round(share * full)) for share in LEVEL_SHARES):
            if BRIGHT_SHARE * full < top < full - width and _is_plateau(number, width):
                return top, float(number[-width:].sum() / channel.size)
    return None


def _histogram(counts: AnyArray, full: int) -> IndexArray:
    """How many pixels (H, W) have each level, up to the highest; some rows at a time, to save memory."""
    number = np.zeros(1 + max(full, int(counts.max())), int)
    for top in range(0, len(counts), BAND):
        number += np.bincount(counts[top : top + BAND].ravel(), minlength=len(number))
    return np.trim_zeros(number, "b")


def _is_plateau(number: IndexArray, width: int) -> bool:
    """Whether the highest of the levels, `width` values each, is far more frequent than that below it."""
    levels = number[len(number) % width :].reshape(-1, width).sum(axis=1)
    below = next((n for n in levels[-2::-1] if n), 0)
    return bool(levels[-1] >= PLATEAU_PIXELS and levels[-1] > PLATEAU_CLEAR * below)


def exposure_ratio(short: FloatArray, long: FloatArray, step: float = 0.0) -> tuple[float, float]:
    """True over stated ratio of two exposures of one picture, and its standard error.

    `short` and `long` (H, W) are the radiances of the photographs by their stated exposures, NaN where
    unusable; `step` is that of one count of the shorter. Means of bright and of dark pixels are compared,
    chosen by what the longer photograph shows around them: so black levels that differ and noise do not
    matter.

    Returns
    -------
    ratio : 1 if the stated exposure times are right; NaN if the picture has no bright and dark pixels, or
        if the shorter photograph does not show them.
    """
    usable = np.isfinite(short) & np.isfinite(long)
    if not usable.any():
        return np.nan, np.nan
    around = _around(long, usable)
    level = float(np.percentile(around[usable], 99))
    bright, dark = usable & (around > DIM_BRIGHT * level), usable & (around < DIM_DARK * level)
    if min(bright.sum(), dark.sum()) < DIM_PIXELS:
        return np.nan, np.nan
    rise = [float(x[bright].mean(dtype=float) - x[dark].mean(dtype=float)) for x in (short, long)]
    noise = [
        float(np.std((short - long / max(rise[1], 1e-12) * rise[0])[p])) for p in (bright, dark)
    ]
    errors = [
        np.hypot(each / group.sum() ** 0.5, _rounding(each, step))
        for each, group in zip(noise, (bright, dark), strict=True)
    ]
    sigma = float(np.hypot(*errors))
    if not rise[0] > DIM_SIGMAS * sigma:
        return np.nan, np.nan
    return rise[1] / rise[0], sigma / rise[0]


def _around(light: FloatArray, usable: BoolArray) -> Array:
    """Means (H, W) of the usable pixels around each, whose noise is not that of the pixel; 0 of none.

    The nearest count as the pixel itself: they share its noise where colours are interpolated.
    """
    number, total = (
        AROUND**2 * uniform_filter(x, AROUND, mode="constant")
        - NEAR**2 * uniform_filter(x, NEAR, mode="constant")
        for x in (usable.astype(float), np.where(usable, light, 0.0).astype(float))
    )
    return np.asarray(np.divide(total, number, out=np.zeros_like(total), where=number > 0.5))


def _rounding(noise: float, step: float) -> float:
    """Standard error of a mean of values rounded to steps, which noise averages out; both by its units.

    Widrow, Kollar and Liu 1996, doi:10.1109/19.492748: the first term of the error of a rounded normal
    distribution; without noise that of an even one. Rounding adds up to a quarter to the noise's variance.
    """
    if not step > 0:
        return 0.0
    spread = max((noise / step) ** 2 - 1 / 4, 0.0)
    return step * min(1 / 12**0.5, float(np.exp(-2 * np.pi**2 * spread)) / np.pi)


def fit_dark_frames(
    short: AnyArray, long: AnyArray, exposures_s: tuple[float, float]
) -> tuple[float, Array]:
    """Black level [DN], and ambient light with dark current (H, W) [DN/s], from two dark photographs.

    A line through both exposures [s] per pixel; the black level is its intercept, averaged over the
    pixels between the quartiles.
    """
    first, second = np.asarray(short, float), np.asarray(long, float)
    slope = (second - first) / (exposures_s[1] - exposures_s[0])
    intercept = first - exposures_s[0] * slope
    # the mean of all would include lamps in view; the median alone is a whole count
    low, high = np.quantile(intercept, [0.25, 0.75])
    return float(intercept[(intercept >= low) & (intercept <= high)].mean()), slope


def response_exponent(
    longer: AnyArray, shorter: AnyArray, ratio: float, usable: BoolArray
) -> float:
    """Exponent of the camera's response: signals (H, W) [DN] grow by `ratio` to this power; 1 is linear."""
    sound = usable & (shorter > 0) & (longer > 0)
    grown = float(np.median(np.asarray(longer[sound], float) / shorter[sound]))
    return float(np.log(grown) / np.log(ratio))


def additivity(
    parts: tuple[AnyArray, AnyArray], white: AnyArray, black: AnyArray, lit: BoolArray
) -> float:
    """Sum of the light of the panel's two halves over that of white; 1 if light adds up.

    All (H, W), at one exposure [DN]. Both halves contain black, so it is subtracted twice.
    """
    summed = np.asarray(parts[0], float) + parts[1] - 2.0 * black
    return float(np.median(summed[lit] / (np.asarray(white, float) - black)[lit]))


def grey_gamma(
    grey: AnyArray, white: AnyArray, black: AnyArray, lit: BoolArray, drive: float
) -> float:
    """Exponent of the projector's response, from a grey of `drive` 0..1 and white (H, W) [DN]."""
    share = (np.asarray(grey, float) - black)[lit] / (np.asarray(white, float) - black)[lit]
    return float(np.log(max(float(np.median(share)), 1e-6)) / np.log(drive))


def brightness_ratio(first: AnyArray, second: AnyArray, lit: BoolArray) -> float:
    """Brightness of the second photograph of a picture over the first, as signals (H, W) [DN]."""
    return float(np.median(second[lit]) / max(float(np.median(first[lit])), 1.0))


def edge_blur(pattern: Image, inverse: Image, white: Image) -> float:
    """Standard deviation [px] of the blur of stripes' edges; NaN where no edge is seen.

    At the middle of an edge with a Gaussian blur, the difference of a pattern and its inverse (H, W), as a
    share of their sum, has the slope sqrt(2/pi) / blur of its contrast, which scattered light lowers from
    place to place.
    """
    total = pattern + inverse
    lit = white > LIT_SHARE * float(np.percentile(white, 99))
    lit &= np.abs(total - white) < NOT_WHITE * white  # else a shot mark
    share = np.where(lit, (pattern - inverse) / np.maximum(total, 1e-9), np.float32(np.nan))
    down, across = np.gradient(share)
    slope, known = np.hypot(down, across), np.nan_to_num(share)
    sides = [maximum_filter(side, 2 * REACH_PX + 1) for side in (known, -known)]
    contrast = np.minimum(*sides)
    usual = float(np.percentile(np.abs(known[lit]), 90)) if lit.any() else 0.0
    near = np.isfinite(slope) & (contrast > LEAST_CONTRAST * usual)
    near &= np.abs(known) < NEAR_EDGE * contrast
    if near.sum() < MIN_PIXELS:
        return float("nan")
    edges = slope[near] / contrast[near]
    steep = float(np.median(edges[edges > FLAT * np.quantile(edges, STEEPEST)]))
    return float(np.sqrt(2 / np.pi) / max(steep, 1e-9))
