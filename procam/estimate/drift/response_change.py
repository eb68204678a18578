"""How a projector's response changed, by pictures of tiles of all drive levels.

Of each level the light over that of white, less that of the darkest level, is a point of the response. The
same picture before and now gives the change of its exponent, a raised black, and light that depends on the
picture (an iris or an economy mode), which makes all levels dimmer than white alone would have it.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from procam.arrays import Array, FloatArray, Image, IndexArray
from procam.estimate.light.projector_response import tile_levels
from procam.estimate.structured_light.patterns import LEVELS
from procam.maths.statistics import MEDIAN_SIGMA
from procam.model.photometry import Photometry

LEAST_POINTS = 20  # of a level
DRIVES = np.array(LEVELS) / 255
LEAST_SPAN = 0.05  # of white, for a channel that shines
LEAST_LIGHT = 2e-5  # of white: less is the noise of black
GAMMA = 2.2  # of the domain of interpolation
FLOOR_SIGMA = 1e-4  # of white: what a camera's own curve may be off by


@dataclass(frozen=True, slots=True)
class LevelLight:
    """Light of each drive level over that of white: `mean` (L, 3) and its standard error `sigma` (L, 3).

    NaN for levels, and channels, that are not seen.
    """

    mean: Array
    sigma: Array

    @classmethod
    def of(cls, levels: Image, white: Image, level: IndexArray) -> "LevelLight":
        """Medians of the light of level tiles (h, w, 3) over white, with `level` (h, w) of `tile_index`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = levels / white
        mean, sigma = (np.full((len(LEVELS), 3), np.nan) for _ in range(2))
        for number in range(len(LEVELS)):
            values = share[level == number]
            values = values[np.isfinite(values).all(axis=1)]
            if len(values) >= LEAST_POINTS:
                mean[number] = np.median(values, axis=0)
                spread = np.median(np.abs(values - mean[number]), axis=0) * 1.4826
                sigma[number] = np.hypot(
                    MEDIAN_SIGMA * spread / np.sqrt(len(values) / 4), FLOOR_SIGMA
                )
        return cls(mean, sigma)

    @property
    def span(self) -> tuple[Array, Array]:
        """Light of the brightest less that of the darkest level, over white (3,), and its sigma."""
        return self.mean[-1] - self.mean[0], np.hypot(self.sigma[-1], self.sigma[0])

    def curve(self) -> tuple[Array, Array]:
        """Response (L, 3) from 0 to 1, and its sigma."""
        span, _ = self.span
        span = np.where(np.abs(span) > LEAST_SPAN, span, np.nan)
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
    """

    exponent: float
    exponent_sigma: float
    span: Array
    span_sigma: Array

    def without_scatter(self, share: float, ratio: Array) -> "ResponseChange":
        """The same where scattered light, a `share` of white, is `ratio` (3,) times as much."""
        return replace(self, span=self.span * (1 + share * (ratio - 1)))


def raised_drive(photometry: Photometry, light: float) -> float:
    """Drive of black that a projector's response needs for `light` over white beside its own black."""
    levels, curve = photometry.response.levels, photometry.response.values.mean(axis=1)
    return float(np.interp(light, curve, levels)) if light > LEAST_LIGHT else 0.0


def compare_levels(before: LevelLight, now: LevelLight, raised: float) -> ResponseChange | None:
    """The change from one photograph of level tiles to another; None if too little is seen.

    `raised` is the drive that black has become: levels d are shown as raised + (1 - raised) d.
    """
    (old, old_sigma), (new, new_sigma) = before.curve(), now.curve()
    spans, sigmas = zip(before.span, now.span, strict=True)
    channels = np.isfinite(old).all(axis=0) & np.isfinite(new).all(axis=0)
    if not channels.any():
        return None
    old, new = old[:, channels], new[:, channels]
    sigma = np.hypot(old_sigma, new_sigma)[:, channels]

    def off(x: Array) -> Array:
        return np.asarray(((_altered(old, float(x[0]), raised) - new) / sigma)[1:-1].ravel())

    found = least_squares(off, np.zeros(1), loss="soft_l1", x_scale=0.01)
    scale = max(1.0, 2 * found.cost / max(1, found.fun.size - 1))
    exponent = float(np.exp(found.x[0]))
    error = float(np.sqrt(scale / np.sum(np.asarray(found.jac) ** 2)))
    with np.errstate(divide="ignore", invalid="ignore"):
        span = np.where(channels, spans[1] / spans[0], np.nan)
        span_sigma = span * np.hypot(sigmas[0] / spans[0], sigmas[1] / spans[1])
    return ResponseChange(exponent, exponent * error, span, span_sigma)


def _altered(old: Array, change: float, raised: float) -> Array:
    """A response (L, C) with its exponent times exp(change), where black is a drive `raised`."""
    drive = raised + (1 - raised) * DRIVES
    light = np.stack([_between(drive, column) for column in old.T], axis=1) ** np.exp(change)
    return np.asarray((light - light[0]) / (light[-1] - light[0]))


def _between(drive: Array, column: Array) -> Array:
    """A response (L,) at other drives (n,), interpolated where it is nearly linear."""
    return np.asarray(np.interp(drive, DRIVES, np.clip(column, 0, None) ** (1 / GAMMA)) ** GAMMA)
