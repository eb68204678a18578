"""What a projector's menu does to its pictures, from photographs of `behaviour_patterns`.

All tests are linear relations that hold for any screen, however strongly it scatters, as long as the
projector adds up light and keeps still. Each gives an `Effect`: a finding needs both its size and its
significance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import (
    binary_erosion,
    distance_transform_edt,
    gaussian_filter,
    label,
    median_filter,
)

from procam.errors import NotEnoughData
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.projector_tests.patterns import (
    COUNT,
    GREYS,
    STRIPE_PX,
    PatchLayout,
    patch_bits,
    patch_codes,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Steps = dict[int, tuple[float, float]]  # light of drives out of 255, and variances; NaN unseen
SIGNIFICANT = 5.0  # sigmas
GAMMA = 2.2
CLEAR_SIGMAS = 6.0
FAINT_SHARE = 0.02  # of the brightest light: too dark to divide by
INSIDE = 0.5  # of a patch's plateau: its geometrical border
MARGIN_PX = 3.0  # of the projector: blur and sharpness reach no further
FEWEST_CAMERA_PIXELS = 4
FEWEST_PATCHES = 6
LEAST_STEP = 0.25  # of the light that a step near black should have: less is none
TILE_SPACINGS, SMOOTH_SPACINGS = 3.0, 0.6  # of stripes, as the camera sees them
STRIPED = 0.25  # of the strongest stripes' power
FEWEST_TILES = 6
LEAST_POWER = 1e-3  # of stripes of both slants: what is less is noise


@dataclass(frozen=True, slots=True)
class Effect:
    """One test: what was found (NaN: not seen), its sigma, and what is still right; shares of 1."""

    name: str
    value: float
    sigma: float
    limit: float

    @property
    def known(self) -> bool:
        """Whether enough was seen to tell."""
        return bool(np.isfinite(self.value) and np.isfinite(self.sigma))

    @property
    def found(self) -> bool:
        """Whether it is too large, and no accident."""
        return abs(self.value) > max(self.limit, SIGNIFICANT * self.sigma)


@dataclass(frozen=True, slots=True)
class PatchLight:
    """Mean signals (8, C) of the patches above the black level [DN], and their variances; NaN unseen."""

    mean: Array
    variance: Array

    def scaled(self, factor: float) -> "PatchLight":
        """As much at an exposure `factor` times as long."""
        return PatchLight(factor * self.mean, factor**2 * self.variance)

    def __add__(self, other: "PatchLight") -> "PatchLight":
        return PatchLight(self.mean + other.mean, self.variance + other.variance)

    def __sub__(self, other: "PatchLight") -> "PatchLight":
        return self + other.scaled(-1)

    def where(self, chosen: Mask, other: "PatchLight") -> "PatchLight":
        """These where `chosen` (8,), the other's elsewhere."""
        pick = chosen[:, None]
        return PatchLight(
            np.where(pick, self.mean, other.mean), np.where(pick, self.variance, other.variance)
        )

    def over(self, other: "PatchLight") -> "PatchLight":
        """Ratio of two independent lights."""
        ratio = self.mean / other.mean
        return PatchLight(ratio, (self.variance + ratio**2 * other.variance) / other.mean**2)

    def all_channels(self) -> "PatchLight":
        """Sum over the channels (8, 1)."""
        return PatchLight(
            self.mean.sum(axis=1, keepdims=True), self.variance.sum(axis=1, keepdims=True)
        )


@dataclass(frozen=True, slots=True)
class Patches:
    """Which camera pixels (H, W) lie well inside which patch (-1: none), and the camera's scale.

    `camera_px` (8,) is how many camera pixels a projector pixel's side has there; NaN if not seen.
    """

    place: NDArray[np.intp]
    camera_px: Array

    @property
    def largest_px(self) -> float:
        """Side of a projector pixel where it looks largest [camera px]."""
        return float(np.nanmax(self.camera_px))

    @property
    def scale(self) -> float:
        """Side of a projector pixel, by and large [camera px]."""
        return float(np.nanmedian(self.camera_px))

    def read(self, signal: NDArray[Any], noise: NoiseLaw) -> PatchLight:
        """Mean light of each patch, of a photograph's signals (H, W, C) above black [DN]."""
        inside = self.place >= 0
        index = self.place[inside]
        values = np.asarray(signal[inside], float)
        count = np.bincount(index, minlength=COUNT)[:, None].astype(float)
        sums = np.stack([np.bincount(index, v, COUNT) for v in values.T], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(count > 0, sums / count, np.nan)
            return PatchLight(mean, noise.variance(np.maximum(mean, 0)) / count)


def find_patches(
    pair: tuple[Array, Array],
    bits: Sequence[Array],
    span: Array,
    noise: NoiseLaw,
    layout: PatchLayout,
) -> Patches:
    """Patches in signals (H, W) of `PatchLayout.pair` and of bits 1 and 2; `span` is white - black.

    Raises
    ------
    NotEnoughData : fewer than six patches are well seen.
    """
    clear = span > np.maximum(CLEAR_SIGMAS * noise.variance(span) ** 0.5, FAINT_SHARE * span.max())
    direct = pair[0] - pair[1]
    share = np.where(clear, np.abs(direct) / np.where(clear, span, 1), 0)
    share = median_filter(share, 3)
    plateau = float(np.quantile(share[share > INSIDE * share.max()], 0.5)) if share.any() else 1.0
    middle = 0.5 * (pair[0] + pair[1])
    spelt = (direct > 0).astype(np.intp)
    for bit, signal in enumerate(bits, start=1):
        spelt |= median_filter(signal > middle, 3).astype(np.intp) << bit
    place = np.full(span.shape, -1)
    camera_px = np.full(COUNT, np.nan)
    for index, code in enumerate(patch_codes()):
        blob = _largest((share > INSIDE * plateau) & (spelt == code))
        scale = float(blob.sum()) ** 0.5 / layout.side_px
        inner = distance_transform_edt(blob) > max(MARGIN_PX * scale, 1.0)
        if inner.sum() >= FEWEST_CAMERA_PIXELS:
            place[inner], camera_px[index] = index, scale
    seen = int(np.isfinite(camera_px).sum())
    if seen < FEWEST_PATCHES:
        raise NotEnoughData(
            f"test patches: got {seen} of {COUNT} that the camera sees well, expected "
            f"{FEWEST_PATCHES} or more; turn the camera towards the picture, or use more pixels"
        )
    return Patches(place, camera_px)


def direct_light(pair: tuple[PatchLight, PatchLight]) -> PatchLight:
    """White of each patch as it comes straight from the projector: scattered light cancels."""
    return (pair[0] - pair[1]).where(patch_bits(0), pair[1] - pair[0])


def load_effect(name: str, loaded: PatchLight, alone: PatchLight, limit: float) -> Effect:
    """How much brighter (+) or darker a patch is with light elsewhere than alone, or after black."""
    ratio = loaded.all_channels().over(alone.all_channels())
    return _mean_effect(name, ratio.mean[:, 0] - 1, ratio.variance[:, 0], limit)


def colour_effects(
    colours: Sequence[PatchLight], pair: tuple[PatchLight, PatchLight], limit: float
) -> tuple[Effect, Effect]:
    """How much brighter white is than red + green + blue, and than half of cyan + magenta + yellow.

    Of the worst channel each; `colours` are those of `PatchLayout.colours`, `pair` of `PatchLayout.pair`.
    """
    first, direct = patch_bits(0), direct_light(pair)
    left = (colours[0] + colours[1] + colours[2]) - (pair[0] + pair[1].scaled(2))
    found = []
    for name, chosen, share in (("primaries", first, 1.0), ("secondaries", ~first, 0.5)):
        more = left.scaled(share).over(direct)  # of the sum than of white
        brighter, variance = -more.mean / (1 + more.mean), more.variance / (1 + more.mean) ** 4
        each = [
            _mean_effect(name, brighter[chosen, c], variance[chosen, c], limit)
            for c in range(brighter.shape[1])
        ]
        found.append(max(each, key=lambda effect: abs(effect.value)))
    return found[0], found[1]


def step_light(
    levels: Sequence[int],
    steps: PatchLight,
    pair: tuple[PatchLight, PatchLight],
    black: PatchLight,
) -> Steps:
    """Light of patches of drives `levels` (8,), out of 255, as a share of white's.

    Scattered light is taken off as the pair has it: in either picture half of the patches are white.
    """
    scattered = (pair[1].where(patch_bits(0), pair[0]) - black).all_channels()
    mean = float(((np.array(levels) / 255) ** GAMMA).mean())  # good enough for what is scattered
    straight = (steps - black).all_channels() - scattered.scaled(2 * mean)
    share = straight.over(direct_light(pair).all_channels())
    light = dict.fromkeys(levels, (np.nan, np.nan))
    for level in light:
        chosen = (np.array(levels) == level) & np.isfinite(share.mean[:, 0])
        if chosen.any():
            values, variances = share.mean[chosen, 0], share.variance[chosen, 0]
            light[level] = float(values.mean()), float(variances.mean() / chosen.sum())
    return light


def clipped_white(bright: Steps, limit: float) -> Effect:
    """What is missing of the step from drive 247 to 255: 0 as of gamma 2.2, 1 where there is none."""
    expected = 1 - (247 / 255) ** GAMMA
    (top, top_variance), (below, below_variance) = bright[255], bright[247]
    value = 1 - (top - below) / expected
    return Effect("white-end", value, (top_variance + below_variance) ** 0.5 / expected, limit)


def clipped_black(dark: Steps, limit: float) -> Effect:
    """What is missing of the light of drive 16, judged by that of 24: 0 as of gamma 2.2, 1 for none."""
    (zero, zero_variance), (low, low_variance), (high, high_variance) = (
        dark[level] for level in (0, 16, 24)
    )
    step, expected = max(high - zero, LEAST_STEP * (24 / 255) ** GAMMA), (16 / 24) ** GAMMA
    ratio = (low - zero) / step
    variance = low_variance + ratio**2 * high_variance + (1 - ratio) ** 2 * zero_variance
    return Effect("black-end", 1 - ratio / expected, variance**0.5 / step / expected, limit)


def remnant(
    early: PatchLight, late: PatchLight, direct: PatchLight, limit: float, name: str
) -> Effect:
    """How much of the pair's first picture is left in the second, photographed early and late."""
    left = (early - late).over(direct).all_channels()
    sign = np.where(patch_bits(0), 1.0, -1.0) / early.mean.shape[1]
    return _mean_effect(name, sign * left.mean[:, 0], sign**2 * left.variance[:, 0], limit)


@dataclass(frozen=True, slots=True)
class StripedView:
    """What turns photographs of stripes into their strength: signals (H, W) of white and black [DN].

    `largest_px` is the side of a projector pixel where it looks largest [camera px].
    """

    white: Array
    black: Array
    noise: NoiseLaw
    largest_px: float

    @property
    def spacing_px(self) -> float:
        """From stripe to stripe, where they are widest [camera px]."""
        return self.largest_px * STRIPE_PX / 2**0.5

    def power(self, stripes: Array) -> Array:
        """Mean square (n,) of stripes about their local mean, as a share of white, tile by tile.

        NaN for tiles that are not wholly in view. White in the denominator takes off what paint and
        lenses do to both.
        """
        span = self.white - self.black
        seen = span > np.maximum(CLEAR_SIGMAS * self.noise.variance(self.white) ** 0.5, 1.0)
        share = np.where(seen, (stripes - self.black) / np.where(seen, span, 1), 0.0)
        sigma = SMOOTH_SPACINGS * self.spacing_px
        wave = share - gaussian_filter(share, sigma)
        taken = 1 - 1 / (np.pi * sigma**2) + 1 / (4 * np.pi * sigma**2)  # of white noise
        of_white = self.noise.variance(self.white) * share**2
        noise = (self.noise.variance(stripes) + of_white) / np.where(seen, span, 1) ** 2
        inner = binary_erosion(seen, iterations=int(np.ceil(2 * sigma)))
        return self._tiles(np.where(inner, wave**2 - taken * noise, np.nan))

    def _tiles(self, image: Array) -> Array:
        side = max(int(TILE_SPACINGS * self.spacing_px), 1)
        height, width = (size // side for size in image.shape)
        cut = image[: height * side, : width * side].reshape(height, side, width, side)
        return np.asarray(cut.mean(axis=(1, 3)).ravel())


def slant_effect(falling: Array, rising: Array, limit: float) -> Effect:
    """How much stronger stripes of one slant are than of the other, from their powers (n,) by tile."""
    chosen = _striped(falling + rising)
    least = LEAST_POWER * (falling + rising)[chosen]
    ratio = 0.5 * np.log(np.maximum(rising[chosen], least) / np.maximum(falling[chosen], least))
    return _mean_effect("slants", ratio, np.zeros_like(ratio), limit)


def sharpness_effect(grey: Array, full: Array, bright: Steps, limit: float) -> Effect:
    """How much stronger stripes of two greys are than their light allows; black and white cannot be.

    `grey` and `full` are powers (n,) by tile of stripes of one slant, `bright` as of `step_light`.
    """
    chosen = _striped(full) & (grey > 0)
    (low, low_variance), (high, high_variance) = (bright[level] for level in GREYS)
    white, white_variance = bright[255]
    expected = (high - low) / white
    ratio = np.sqrt(grey[chosen] / full[chosen]) / expected
    by_light = (low_variance + high_variance + expected**2 * white_variance) / (high - low) ** 2
    effect = _mean_effect("grey-stripes", ratio - 1, np.zeros_like(ratio), limit)
    return Effect(effect.name, effect.value, float(np.hypot(effect.sigma, by_light**0.5)), limit)


def _striped(power: Array) -> Mask:
    """Tiles (n,) with strong stripes: the direct light is there, and sharp. None if they are few."""
    strongest = float(np.nanmax(power)) if np.isfinite(power).any() else 0.0
    chosen = power > max(STRIPED * strongest, 0.0)
    return np.asarray(chosen & (chosen.sum() >= FEWEST_TILES))


def _mean_effect(name: str, values: Array, variances: Array, limit: float) -> Effect:
    """Mean over patches or tiles; sigma by their noise or by their own spread, whichever is more."""
    seen = np.isfinite(values)
    values, variances = values[seen], variances[seen]
    count = len(values)
    if count == 0:
        return Effect(name, np.nan, np.nan, limit)
    by_noise = float(variances.sum()) ** 0.5 / count
    by_spread = float(values.std(ddof=1)) / count**0.5 if count > 1 else 0.0
    return Effect(name, float(values.mean()), max(by_noise, by_spread), limit)


def _largest(mask: Mask) -> Mask:
    """The largest connected part of a mask (H, W)."""
    labels, count = label(mask)
    if count == 0:
        return mask
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(labels == sizes.argmax())
