"""Projector response from flat grey levels photographed at one exposure, with black and white among them.

The light of a level is its sum over the lit picture, less black, over that of white: f of
docs/theory/photometry.md (R2), of all primaries together.
Scattered light is in proportion to the projector's light and drops out.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from procam.arrays import Array, FloatArray
from procam.errors import NotEnoughData, OutOfModelRange
from procam.estimate.light.projector_response import FALL_SIGMAS, MIN_FALL, dense_curve
from procam.model.photometry import ResponseCurve

GRID = 64  # rows and columns of squares that a photograph is averaged to
MIN_LIT = 0.3  # of the brightest squares' light, for a square to count as lit
MIN_SQUARES = 50
FOLDS = 10  # of lit squares, left out in turn for the standard errors
WHITE = 255


def fit_gamma_set(photographs: Iterable[FloatArray], drives: Sequence[int]) -> ResponseCurve:
    """Response from linear photographs (H, W, C), NaN where saturated, of grey `drives` 0..255.

    Raises
    ------
    NotEnoughData
        Black or white is missing, or too little of the picture is lit and unsaturated in white.
    OutOfModelRange
        Light falls while the drive rises.
    """
    order = np.argsort(drives, kind="stable")
    levels = np.asarray(drives)[order]
    if levels[0] != 0 or levels[-1] != WHITE or (np.diff(levels) == 0).any():
        raise NotEnoughData(
            f"gamma set: drives {', '.join(map(str, levels))}; each level once is needed, with 0 and {WHITE}"
        )
    light = np.stack([_squares(photo) for photo in photographs])[order]
    light = light[1:] - light[0]
    white = light[-1].mean(axis=-1)
    lit = np.isfinite(white) & (white > MIN_LIT * np.nanpercentile(np.append(white, 0.0), 99))
    if lit.sum() < MIN_SQUARES:
        raise NotEnoughData(
            f"gamma set: {int(lit.sum())} of {white.size} squares of the picture are lit and nowhere "
            f"saturated in white, {MIN_SQUARES} are needed; expose so that white is just below saturation"
        )
    values, sigma = _relative(light[:, lit])
    _check_rising(levels, values, sigma)
    rising = np.maximum.accumulate(np.clip(values, 0, 1), axis=0)
    return dense_curve(levels / WHITE, rising, sigma)


def _squares(photo: FloatArray) -> Array:
    """Means (N, 3) over squares; one channel counts for all."""
    height, width = photo.shape[:2]
    edge = max(1, min(height, width) // GRID)
    rows, columns = height // edge, width // edge
    cut = photo[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge, -1)
    mean = cut.mean(axis=(1, 3), dtype=float).reshape(rows * columns, -1)
    return np.broadcast_to(mean, (rows * columns, 3)) if mean.shape[1] == 1 else mean


def _relative(light: Array) -> tuple[Array, Array]:
    """Light (K + 1, 3) of drives over white's, 0 first, and its jackknife standard errors."""
    folds = np.arange(light.shape[1]) % FOLDS
    sums = np.stack([light[:, folds == fold].sum(axis=1) for fold in range(FOLDS)])
    total = sums.sum(axis=0)
    without = total - sums
    values = total / total[-1]
    ratios = without / without[:, -1:]
    sigma = np.sqrt((FOLDS - 1) / FOLDS * ((ratios - ratios.mean(axis=0)) ** 2).sum(axis=0))
    black = np.zeros((1, 3))
    return np.vstack([black, values]), np.vstack([black, sigma])


def _check_rising(levels: Array, values: Array, sigma: Array) -> None:
    fall = values[:-1] - values[1:]
    noise = np.maximum(FALL_SIGMAS * np.hypot(sigma[:-1], sigma[1:]), MIN_FALL)
    if (fall > noise).any():
        level = levels[int(np.argmax((fall - noise).max(axis=1)))]
        raise OutOfModelRange(
            f"gamma set: light falls by {fall[fall > noise].max():.1%} of white above drive {level}/{WHITE}; "
            "check the order of the photographs, and switch off automatic exposure and the projector's "
            "contrast enhancement"
        )
