"""Projector response and colour from pictures corrected for the light they send round the dome."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.structured_light.patterns import LEVELS, level_tile
from procam.model.photometry import ResponseCurve

Array = NDArray[np.float64]
Image = NDArray[np.float32]
TILE_MARGIN_PX = 5
GAMMA = 2.2  # the interpolation runs in a domain where displays are nearly straight
TABLE = 257
MIN_SAMPLES = 50


@dataclass(frozen=True, slots=True)
class ColourFit:
    """(3, 3) camera channel per primary, relative to white; rows sum to 1 when light adds up.

    `additivity_error` is the worst |sum of primaries / white - 1|.
    """

    mix: Array
    additivity_error: float


def fit_colour(primaries: list[Image], direct: Image) -> ColourFit:
    """Colour mixing from the direct light (H, W, 3) of R, G, B alone and of white."""
    use = direct[..., 1] > 0.3 * np.percentile(direct[..., 1], 99)
    use &= np.all([np.isfinite(p).all(axis=-1) for p in primaries], axis=0)
    white = direct[use].sum(axis=0, dtype=float)
    mix = np.stack([p[use].sum(axis=0, dtype=float) / white for p in primaries], axis=1)
    error = float(np.abs(mix.sum(axis=1) - 1).max())
    return ColourFit(mix / mix.sum(axis=1, keepdims=True), error)


def tile_levels(
    picture: NDArray[np.floating], projector_xy: Image, lit: NDArray[np.bool_]
) -> NDArray[np.intp]:
    """Index into LEVELS (H, W) that each camera pixel sees of a level picture; -1 near tile edges."""
    height, width = picture.shape[:2]
    tile = level_tile((width, height))
    inside = lit & np.isfinite(projector_xy[..., 0])
    place = np.mod(np.nan_to_num(projector_xy) + 0.5, tile)
    inside &= np.all(np.abs(place - tile / 2) < tile / 2 - TILE_MARGIN_PX, axis=-1)
    xy = np.rint(np.nan_to_num(projector_xy)).astype(int)
    drive = picture[np.clip(xy[..., 1], 0, height - 1), np.clip(xy[..., 0], 0, width - 1), 0]
    return np.where(inside, np.searchsorted(LEVELS, np.rint(255 * drive)), -1)


class ProjectorResponseFit:
    """Collects (level, direct light) samples of a projector; white's direct light is the unit."""

    def __init__(self, direct: Image, mix: Array) -> None:
        self._direct = direct
        self._unmix = np.linalg.inv(mix)
        self._sums = np.zeros((len(LEVELS), 3, 3))  # per level: sum x, x^2 and count, per channel

    def add(self, light: Image, level: NDArray[np.intp]) -> None:
        """Fold in the direct light (H, W, 3) of a level picture."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = light / self._direct
        use = (level >= 0) & np.isfinite(relative).all(axis=-1) & (self._direct.min(axis=-1) > 0)
        amounts = relative[use] @ self._unmix.T.astype(np.float32)
        index = level[use]
        for c in range(3):
            for power in (0, 1, 2):
                sums = np.bincount(index, amounts[:, c] ** power, len(LEVELS))
                self._sums[:, power, c] += sums

    def curve(self) -> ResponseCurve:
        """The monotone curve through the levels; refuses one that falls."""
        count, total, square = (self._sums[:, i] for i in range(3))
        if count.min() < MIN_SAMPLES:
            raise NotEnoughData(
                f"response: got {int(count.min())} samples at the rarest of {len(LEVELS)} levels, "
                f"expected {MIN_SAMPLES}; the camera sees too little of this projector"
            )
        mean = total / count
        sigma = np.sqrt(np.maximum(square / count - mean**2, 0) / count)
        drop = mean[:-1] - mean[1:] - 5 * np.hypot(sigma[:-1], sigma[1:])
        if drop.max() > 0:
            level = LEVELS[int(np.argmax(drop.max(axis=1)))]
            raise OutOfModelRange(
                f"response: light falls by {drop.max():.1%} of white above drive {level}/255, "
                "expected a rising curve; switch off the projector's contrast enhancement"
            )
        values = np.maximum.accumulate(np.clip(mean, 0, None), axis=0)
        values = (values - values[0]) / (values[-1] - values[0])
        return _dense(np.array(LEVELS) / 255, values, sigma)


def _dense(levels: Array, values: Array, sigma: Array) -> ResponseCurve:
    fine = np.linspace(0, 1, TABLE)
    straight = PchipInterpolator(levels, values ** (1 / GAMMA), axis=0)(fine) ** GAMMA
    spread = np.stack([np.interp(fine, levels, sigma[:, c]) for c in range(3)], axis=1)
    return ResponseCurve(fine, np.asarray(straight), spread)
