"""Projector response and colour mix, from photographs corrected for scattered light.

Primaries give the colour mix; tiles of several drive levels in one picture give the response. Both fit
docs/theory/photometry.md (R2). Left in, scattered light would bend the curve.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import label as connected_parts

from procam.arrays import Array, BoolArray, FloatArray, Image, IndexArray
from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.structured_light.patterns import LEVELS, level_tile
from procam.model.photometry import ResponseCurve

TILE_MARGIN_PX = 5
GAMMA = 2.2  # of the domain of the interpolation, where displays are nearly linear
TABLE = 257  # entries of the curve
MIN_SAMPLES, MIN_TILES = 50, 2  # camera pixels, and tiles, per level
MIN_LEVEL = 0.3  # of white, for colour
MIN_DIRECT = 0.05  # of the brightest, for the response: a floor beside a lit wall has less
# a fall of the curve that is no noise: in standard errors of its pixels, and of white, for the scattered
# light taken out of a picture is known to its share
FALL_SIGMAS, MIN_FALL = 5.0, 1e-3


@dataclass(frozen=True, slots=True)
class ColourFit:
    """`mix` (3, 3): camera channel per primary, relative to white; rows sum to 1.

    `additivity_error`: largest |sum of primaries / white - 1|, 0 if light is additive.
    """

    mix: Array
    additivity_error: float


def fit_colour(primaries: Iterable[Image], direct: Image) -> ColourFit:
    """Colour mix from the direct light (H, W, 3) of R, G, B alone and of white."""
    use = direct[..., 1] > MIN_LEVEL * np.percentile(direct[..., 1], 99)
    lights = [primary[use] for primary in primaries]
    known = np.all([np.isfinite(light).all(axis=-1) for light in lights], axis=0)
    white = direct[use][known].sum(axis=0, dtype=float)
    mix = np.stack([x[known].sum(axis=0, dtype=float) / white for x in lights], axis=1)
    error = float(np.abs(mix.sum(axis=1) - 1).max())
    return ColourFit(mix / mix.sum(axis=1, keepdims=True), error)


def tile_levels(picture: FloatArray, projector_xy: Image, lit: BoolArray) -> IndexArray:
    """Index (H, W) into LEVELS of each camera pixel of a level picture; -1 near the tiles' edges."""
    height, width = picture.shape[:2]
    tile = level_tile((width, height))
    inside = lit & np.isfinite(projector_xy[..., 0])
    place = np.mod(np.nan_to_num(projector_xy) + 0.5, tile)
    inside &= np.all(np.abs(place - tile / 2) < tile / 2 - TILE_MARGIN_PX, axis=-1)
    xy = np.rint(np.nan_to_num(projector_xy)).astype(int)
    drive = picture[np.clip(xy[..., 1], 0, height - 1), np.clip(xy[..., 0], 0, width - 1), 0]
    return np.where(inside, np.searchsorted(LEVELS, np.rint(255 * drive)), -1)


class ProjectorResponseFit:
    """Running fit of the response to direct light of level pictures, relative to that of white."""

    def __init__(self, direct: Image, mix: Array) -> None:
        self._direct = direct
        least = np.nan_to_num(direct.min(axis=-1))
        brightest = float(np.percentile(least[least > 0], 99)) if (least > 0).any() else 0.0
        self._bright = (least > 0) & (least > MIN_DIRECT * brightest)
        self._unmix = np.linalg.inv(mix)
        self._tiles = list[Array]()  # rows per tile: level, count, sums of its light per primary

    def add(self, light: Image, level: IndexArray) -> None:
        """Add the direct light (H, W, 3) of a level picture with levels (H, W) of `tile_levels`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = light / self._direct
        use = (level >= 0) & np.isfinite(relative).all(axis=-1) & self._bright
        amounts = relative[use] @ self._unmix.T.astype(np.float32)
        part, _ = connected_parts(level >= 0)  # unknown edges keep tiles apart
        tiles, tile = np.unique(part[use] * len(LEVELS) + level[use], return_inverse=True)
        sums = [np.bincount(tile, weights) for weights in (None, *amounts.T)]
        self._tiles.append(np.stack([tiles % len(LEVELS), *sums], axis=1).astype(float))

    def curve(self) -> ResponseCurve:
        """The monotone curve through the levels.

        Pixels of one tile share the errors of that place, so the standard errors are from the spread
        of tiles.

        Raises
        ------
        NotEnoughData
            If a level has too few samples.
        OutOfModelRange
            If the light falls with the drive.
        """
        mean, sigma = self._levels()
        fall = mean[:-1] - mean[1:]
        noise = np.maximum(FALL_SIGMAS * np.hypot(sigma[:-1], sigma[1:]), MIN_FALL)
        if (fall > noise).any():
            level = LEVELS[int(np.argmax((fall - noise).max(axis=1)))]
            raise OutOfModelRange(
                f"response: light falls by {fall[fall > noise].max():.1%} of white above drive "
                f"{level}/255; switch off the projector's contrast enhancement"
            )
        values = np.maximum.accumulate(np.clip(mean, 0, None), axis=0)
        span = values[-1] - values[0]
        values = (values - values[0]) / span
        ends = (values * sigma[-1]) ** 2 + ((1 - values) * sigma[0]) ** 2
        sigma = np.sqrt(sigma**2 + ends) / span
        sigma[[0, -1]] = 0  # they are 0 and 1 by definition
        return dense_curve(np.array(LEVELS) / 255, values, sigma)

    def _levels(self) -> tuple[Array, Array]:
        """Mean light (L, 3) of the levels, and its standard errors (L, 3)."""
        level, count, *sums = np.concatenate(self._tiles).T
        level, size = level.astype(int), len(LEVELS)
        total, tiles = np.bincount(level, count, size), np.bincount(level, minlength=size)
        if total.min() < MIN_SAMPLES or tiles.min() < MIN_TILES:
            raise NotEnoughData(
                f"response: the rarest of {size} levels has {int(total.min())} samples in {tiles.min()} "
                f"tiles, but {MIN_SAMPLES} in {MIN_TILES} are needed; the camera sees too little of this "
                "projector"
            )
        mean = np.stack([np.bincount(level, s, size) / total for s in sums], axis=1)
        away = np.stack(sums, axis=1) - count[:, None] * mean[level]
        square = np.stack([np.bincount(level, a**2, size) for a in away.T], axis=1)
        return mean, np.sqrt(square * (tiles / (tiles - 1))[:, None]) / total[:, None]


def dense_curve(levels: Array, values: Array, sigma: Array) -> ResponseCurve:
    """The curve on `TABLE` drives, by monotone interpolation."""
    fine = np.linspace(0, 1, TABLE)
    light = PchipInterpolator(levels, values ** (1 / GAMMA), axis=0)(fine) ** GAMMA
    fine_sigma = np.stack([np.interp(fine, levels, sigma[:, c]) for c in range(3)], axis=1)
    return ResponseCurve(fine, np.asarray(light), fine_sigma)
