"""Measures how a projector's response changed, by pictures of tiles of all drive levels.

Of each level the light over that of white, less that of the darkest level, is a point of the response. The
same picture before and now gives the change of its exponent, of the ends of its signal range, a raised black,
and light that depends on the picture (an iris or an economy mode), which makes all levels dimmer than white
alone would have it.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image, IndexArray
from procam.estimate.drift.level_model import EXPONENT, NO_DEPARTURE, LevelModel
from procam.estimate.light.projector_response import tile_levels
from procam.estimate.structured_light.patterns import LEVELS
from procam.maths.statistics import MEDIAN_SIGMA
from procam.model.photometry import Departure, Photometry
from procam.model.transport import Measured

LEAST_POINTS = 20  # of a level
DRIVES = np.array(LEVELS) / 255
LEAST_SPAN = 0.05  # of white, for a channel that shines
LEAST_LIGHT = 2e-5  # of white: less is the noise of black
FEWEST_LEVELS = 3  # that both photographs show
FLOOR_SIGMA = 1e-4  # of white: what a camera's own curve may be off by


@dataclass(frozen=True, slots=True)
class LevelLight:
    """Light of each drive level over that of white: `mean` (L, 3) and its standard error `sigma` (L, 3).

    NaN for levels, and channels, that are not seen.
    """

    mean: Array
    sigma: Array

    @classmethod
    def pair(
        cls, before: tuple[Image, Image], now: tuple[Image, Image], level: IndexArray
    ) -> "tuple[LevelLight, LevelLight]":
        """Medians of the light of level tiles (h, w, 3) over white, before and now.

        `before` and `now` are tiles and white of the same panel pixels, `level` (h, w) is their `tile_index`.
        Pixel by pixel the change is known better than either: scattered light differs within a level.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            old, new = (levels / white for levels, white in (before, now))
        both = np.isfinite(old + new).all(axis=-1)
        mean, change, sigma = (np.full((len(LEVELS), 3), np.nan) for _ in range(3))
        for number in range(len(LEVELS)):
            here = both & (level == number)
            if here.sum() >= LEAST_POINTS:
                difference = new[here] - old[here]
                mean[number] = np.median(old[here], axis=0)
                change[number] = np.median(difference, axis=0)
                spread = np.median(np.abs(difference - change[number]), axis=0) * 1.4826
                sigma[number] = MEDIAN_SIGMA * spread / np.sqrt(here.sum() / 4)
        exact = np.full_like(sigma, FLOOR_SIGMA)
        return cls(mean, exact), cls(mean + change, np.hypot(sigma, FLOOR_SIGMA))

    def doubtful(self, sigma: float) -> "LevelLight":
        """The same, with a further standard error."""
        return replace(self, sigma=np.hypot(self.sigma, sigma))

    @property
    def seen(self) -> BoolArray:
        """Levels (L,) that are seen in all channels."""
        return np.asarray(np.isfinite(self.mean).all(axis=1))

    def at(self, levels: BoolArray) -> "LevelLight":
        """The same of some levels."""
        return LevelLight(self.mean[levels], self.sigma[levels])

    @property
    def span(self) -> tuple[Array, Array]:
        """Light of the brightest less that of the darkest level, over white (3,), and its sigma."""
        return self.mean[-1] - self.mean[0], np.hypot(self.sigma[-1], self.sigma[0])

    def curve(self) -> tuple[Array, Array]:
        """Response (L, 3) from 0 to 1, and its sigma."""
        span, _ = self.span
        span = np.where(span > LEAST_SPAN, span, np.nan)
        return (self.mean - self.mean[0]) / span, self.sigma / span


def tile_index(picture: FloatArray, pixel: Array) -> IndexArray:
    """Index (h, w) into LEVELS of panel pixels (h, w, 2) of a level picture; -1 near the tiles' edges."""
    return tile_levels(picture, np.asarray(pixel, np.float32), np.ones(pixel.shape[:2], bool))


@dataclass(frozen=True, slots=True)
class ResponseChange:
    """Change of a response.

    Attributes
    ----------
    exponent, exponent_sigma : factor on the exponent.
    span, span_sigma : (3,) light of the tiles' picture over that of white, relative to before.
    each, each_sigma : (3,) factor on the exponent of each channel; NaN where it is not seen.
    ends : (2,) drives [-] up to which all is black now, and from which on all is white.
    clipping : largest effect of these ends on light. rest : what neither exponent nor ends explain.
    """

    exponent: float
    exponent_sigma: float
    span: Array
    span_sigma: Array
    each: Array = field(default_factory=lambda: np.full(3, np.nan))
    each_sigma: Array = field(default_factory=lambda: np.full(3, np.nan))
    ends: Array = field(default_factory=lambda: np.array([0.0, 1.0]))
    clipping: Departure = NO_DEPARTURE
    rest: Departure = NO_DEPARTURE

    def without_scatter(self, share: float, ratio: Measured) -> "ResponseChange":
        """The same where scattered light, a `share` of white, is `ratio` (3,) times as much."""
        sigma = np.hypot(self.span_sigma, self.span * share * ratio.sigma)
        return replace(self, span=self.span * (1 + share * (ratio.value - 1)), span_sigma=sigma)


def raised_drive(photometry: Photometry, light: float) -> float:
    """Drive of black that a projector's response needs for `light` over white beside its own black."""
    levels, curve = photometry.response.levels, photometry.response.values.mean(axis=1)
    return float(np.interp(light, curve, levels)) if light > LEAST_LIGHT else 0.0


def compare_levels(before: LevelLight, now: LevelLight, raised: float) -> ResponseChange | None:
    """The change from one photograph of level tiles to another; None if too little is seen.

    Levels that are seen in both photographs count. `raised` is the drive that black has become.
    """
    known = before.seen & now.seen
    if known.sum() < FEWEST_LEVELS:
        return None
    old, new = before.at(known), now.at(known)
    (old_curve, old_sigma), (new_curve, new_sigma) = old.curve(), new.curve()
    channels = np.flatnonzero(
        np.isfinite(old_curve).all(axis=0) & np.isfinite(new_curve).all(axis=0)
    )
    if not len(channels):
        return None
    sigma = np.hypot(old_sigma, new_sigma)
    curves = (old_curve[:, channels], new_curve[:, channels], sigma[:, channels])
    return _described(LevelModel(DRIVES[known], *curves, raised), channels, _span_ratio(old, new))


def _described(
    model: LevelModel, channels: IndexArray, span: tuple[Array, Array]
) -> ResponseChange:
    """What a model explains, of the channels that are seen."""
    found = model.explain()
    exponent = found if EXPONENT[0] in found.freedoms else replace(model.fit(), exponent=1.0)
    seen = np.isin(np.arange(3), channels)
    ratio, sigma = (np.where(seen, part, np.nan) for part in span)
    return ResponseChange(
        exponent.exponent,
        exponent.exponent_sigma,
        ratio,
        sigma,
        *_by_channel(model, channels),
        found.ends,
        model.effect_of_ends(found),
        model.rest(found).in_channel(channels),
    )


def _by_channel(model: LevelModel, channels: IndexArray) -> tuple[Array, Array]:
    """Factor (3,) on the exponent of each channel that is seen, and its standard error."""
    exponent, sigma = np.full((2, 3), np.nan)
    for column, channel in enumerate(channels):
        found = model.of(column).explain()
        if EXPONENT[0] in found.freedoms:
            exponent[channel], sigma[channel] = found.exponent, found.exponent_sigma
    return exponent, sigma


def _span_ratio(before: LevelLight, now: LevelLight) -> tuple[Array, Array]:
    (old, old_sigma), (new, new_sigma) = before.span, now.span
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = new / old
        return ratio, np.abs(ratio) * np.hypot(old_sigma / old, new_sigma / new)
