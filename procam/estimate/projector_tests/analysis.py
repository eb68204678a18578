"""Effects of a projector's settings on its pictures, from photographs of the test patterns.

Every test is a linear relation between photographs that holds for any screen, however strongly it
scatters, as long as the projector's light adds up and does not drift: the same flux elsewhere must not
change a patch, white must be the sum of its colours, steps near black and white must exist, stripes of
both slants must be equally strong. Each test gives an `Effect`; it counts as found only if it is both
large and significant.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, gaussian_filter

from procam.arrays import Array, BoolArray
from procam.estimate.camera.noise import NoiseLaw
from procam.estimate.projector_tests.patches import CLEAR_SIGMAS, PatchLight, direct_light
from procam.estimate.projector_tests.patterns import GREYS, STRIPE_PX, patch_bits

Steps = dict[int, tuple[float, float]]  # light by drive 0..255, and its variance; NaN if unseen
SIGNIFICANT = 5.0  # sigmas
GAMMA = 2.2  # nominal, of a projector
MIN_STEP = 0.25  # of the light that a step near black should have: a smaller one is raised to it
TILE_SPACINGS, SMOOTH_SPACINGS = 3.0, 0.6  # tile and smoothing [stripe spacings in the photograph]
STRIPED = 0.25  # of the largest power: tiles with more show stripes
MIN_TILES = 6
NOISE_POWER = 1e-3  # of the stripes of both slants: less power is noise


@dataclass(frozen=True, slots=True)
class Effect:
    """Result of one test: the effect (NaN if not seen), its sigma and the acceptable limit [share]."""

    name: str
    value: float
    sigma: float
    limit: float

    @property
    def known(self) -> bool:
        """Whether enough was seen for a result."""
        return bool(np.isfinite(self.value) and np.isfinite(self.sigma))

    @property
    def found(self) -> bool:
        """Whether the effect is too large, and significant."""
        return abs(self.value) > max(self.limit, SIGNIFICANT * self.sigma)


def load_effect(name: str, loaded: PatchLight, alone: PatchLight, limit: float) -> Effect:
    """How much brighter (+) or darker a patch is with light elsewhere, or after black, than alone."""
    ratio = loaded.all_channels().over(alone.all_channels())
    return _mean_effect(name, ratio.mean[:, 0] - 1, ratio.variance[:, 0], limit)


def colour_effects(
    colours: Sequence[PatchLight], pair: tuple[PatchLight, PatchLight], limit: float
) -> tuple[Effect, Effect]:
    """How much brighter white is than red + green + blue, and than half of cyan + magenta + yellow.

    Each is that of the worst channel. `colours` are the lights of `PatchLayout.colours`, `pair` of
    `PatchLayout.pair`.
    """
    first, direct = patch_bits(0), direct_light(pair)
    difference = (colours[0] + colours[1] + colours[2]) - (pair[0] + pair[1].scaled(2))
    found = []
    for name, chosen, share in (("primaries", first, 1.0), ("secondaries", ~first, 0.5)):
        more = difference.scaled(share).over(direct)  # light of the sum than of white
        brighter, variance = -more.mean / (1 + more.mean), more.variance / (1 + more.mean) ** 4
        each = [
            _mean_effect(name, brighter[chosen, c], variance[chosen, c], limit)
            for c in range(brighter.shape[1])
        ]
        found.append(max(each, key=lambda effect: abs(effect.value)))
    return found[0], found[1]


def step_light(
    levels: Sequence[int], steps: PatchLight, pair: tuple[PatchLight, PatchLight], black: PatchLight
) -> Steps:
    """Light of patches of drives `levels` (8,), 0..255, as a share of white's.

    The scattered light of the pair, where half of the patches are white, is scaled to the mean light
    of the steps and subtracted.
    """
    scattered = (pair[1].where(patch_bits(0), pair[0]) - black).all_channels()
    mean = float(((np.array(levels) / 255) ** GAMMA).mean())  # accurate enough for scattered light
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
    """Missing share of the step from drive 247 to 255: 0 as of gamma 2.2, 1 if there is no step."""
    expected = 1 - (247 / 255) ** GAMMA
    (top, top_variance), (below, below_variance) = bright[255], bright[247]
    value = 1 - (top - below) / expected
    return Effect("white-end", value, (top_variance + below_variance) ** 0.5 / expected, limit)


def clipped_black(dark: Steps, limit: float) -> Effect:
    """Missing share of the light of drive 16 relative to 24: 0 as of gamma 2.2, 1 if there is none."""
    (zero, zero_variance), (low, low_variance), (high, high_variance) = (
        dark[level] for level in (0, 16, 24)
    )
    step, expected = max(high - zero, MIN_STEP * (24 / 255) ** GAMMA), (16 / 24) ** GAMMA
    ratio = (low - zero) / step
    variance = low_variance + ratio**2 * high_variance + (1 - ratio) ** 2 * zero_variance
    return Effect("black-end", 1 - ratio / expected, variance**0.5 / step / expected, limit)


def persistence_effect(
    early: PatchLight, late: PatchLight, direct: PatchLight, limit: float, name: str
) -> Effect:
    """Share of the first picture of the pair that persists in the second, photographed early and late."""
    remaining = (early - late).over(direct).all_channels()
    sign = np.where(patch_bits(0), 1.0, -1.0) / early.mean.shape[1]
    return _mean_effect(
        name, sign * remaining.mean[:, 0], sign**2 * remaining.variance[:, 0], limit
    )


@dataclass(frozen=True, slots=True)
class StripedView:
    """View of the stripes, with what is needed to measure their power.

    Attributes
    ----------
    white, black : signals (H, W) [DN]. noise : of the camera.
    largest_px : side of a projector pixel where it appears largest [camera px].
    """

    white: Array
    black: Array
    noise: NoiseLaw
    largest_px: float

    @property
    def spacing_px(self) -> float:
        """Distance between stripes where they are widest [camera px]."""
        return self.largest_px * STRIPE_PX / 2**0.5

    def power(self, stripes: Array) -> Array:
        """Mean square (n,) of stripes about their local mean, relative to white, by tile.

        NaN for tiles that are not completely in view. Division by white cancels variations of the
        screen and of lenses.
        """
        span = self.white - self.black
        seen = span > np.maximum(CLEAR_SIGMAS * self.noise.variance(self.white) ** 0.5, 1.0)
        share = np.where(seen, (stripes - self.black) / np.where(seen, span, 1), 0.0)
        sigma = SMOOTH_SPACINGS * self.spacing_px
        wave = share - gaussian_filter(share, sigma)
        taken = (
            1 - 1 / (np.pi * sigma**2) + 1 / (4 * np.pi * sigma**2)
        )  # share of white noise that remains
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
    """Log ratio of the amplitudes of stripes of both slants, from their powers (n,) by tile."""
    chosen = _striped(falling + rising)
    least = NOISE_POWER * (falling + rising)[chosen]
    ratio = 0.5 * np.log(np.maximum(rising[chosen], least) / np.maximum(falling[chosen], least))
    return _mean_effect("slants", ratio, np.zeros_like(ratio), limit)


def sharpness_effect(grey: Array, full: Array, bright: Steps, limit: float) -> Effect:
    """How much stronger stripes of two greys are than their light allows, compared with black and white.

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


def _striped(power: Array) -> BoolArray:
    """Tiles (n,) with strong stripes, which have sharp direct light; none if they are too few."""
    strongest = float(np.nanmax(power)) if np.isfinite(power).any() else 0.0
    chosen = power > max(STRIPED * strongest, 0.0)
    return np.asarray(chosen & (chosen.sum() >= MIN_TILES))


def _mean_effect(name: str, values: Array, variances: Array, limit: float) -> Effect:
    """Mean over patches or tiles; sigma from their noise or their scatter, whichever is larger."""
    seen = np.isfinite(values)
    values, variances = values[seen], variances[seen]
    count = len(values)
    if count == 0:
        return Effect(name, np.nan, np.nan, limit)
    by_noise = float(variances.sum()) ** 0.5 / count
    by_scatter = float(values.std(ddof=1)) / count**0.5 if count > 1 else 0.0
    return Effect(name, float(values.mean()), max(by_noise, by_scatter), limit)
