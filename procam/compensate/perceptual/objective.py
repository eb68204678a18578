"""Visual cost of a picture that differs from its target, and the gradient of the cost.

Equations: docs/theory/perceptual.md. Pictures are planes (3, H, W) in single precision; what is here also
holds for any other arrangement of places (3, N), with the `Levels` of a mesh.
"""

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from procam.arrays import Array, Array32, FloatArray
from procam.maths.vision.contrast import (
    CROSS_CHANNEL,
    DKL_FROM_RGB,
    EXPONENTS,
    GAINS,
    MASKING,
    sensitivity,
)
from procam.maths.vision.pu21 import BRIGHTEST, DARKEST, pu21_table

POWER = 2.5  # of contrast errors
SEATS = (0.5, 1.0, 2.25)  # of the pixels per degree at the eyepoint: seats near and far
COLOURS = 0.1  # weight of each colour's error beside that of luminance
DARKEST_MEAN = 0.01  # cd/m2: a local mean of less counts as this
CURVE_POINTS = 512
LOG_NITS = np.linspace(np.log(DARKEST), np.log(BRIGHTEST), CURVE_POINTS)
COLUMNS = 2**14
#: of ColorVideoVDP's sensitivity: else texture returns in the hue that first exceeds the scattered light
CHROMA_KEPT = (1.0, 2.0, 1.5)
LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)


class Levels(Protocol):
    """Ever smoother versions of a picture, and the adjoints of their steps (`maths.vision.pyramid`)."""

    def __len__(self) -> int:
        """Steps between levels."""

    def frequency(self, level: int) -> float:
        """What is lost from a level to the next [cycles per degree at the eyepoint]."""

    def blurred(self, level: int, plane: Array32) -> Array32:
        """A plane of a level over the reach of masking."""

    def reduced(self, level: int, planes: Array32) -> Array32:
        """From a level to the next."""

    def expanded(self, level: int, planes: Array32) -> Array32:
        """Back to a level from the next."""

    def reduced_adjoint(self, level: int, slope: Array32) -> Array32:
        """Adjoint of `reduced`."""

    def expanded_adjoint(self, level: int, slope: Array32) -> Array32:
        """Adjoint of `expanded`."""


@dataclass(frozen=True, eq=False, slots=True)
class _Band:
    """Contrast of the target in a band, and the weight of errors there (3, h, w)."""

    contrast: Array32
    weight: Array32


class Contrast:
    """J: errors of local contrast, each against the picture's own local mean.

    Parameters
    ----------
    levels : of pictures. target : (3, H, W) linear light. weight : (H, W), summing to 1.
    white_nits : luminance of light 1.0 [cd/m2].
    """

    def __init__(self, levels: Levels, target: Array32, weight: Array32, white_nits: float) -> None:
        self._levels, self._white = levels, np.float32(white_nits)
        self._bands = list[_Band]()
        level, share = _opponent(target), weight[None]
        for number in range(len(levels)):
            above = levels.reduced(number, level)
            self._bands.append(self._band(number, level, above, share[0]))
            level, share = above, levels.reduced(number, share)

    def _band(self, number: int, level: Array32, above: Array32, share: Array32) -> _Band:
        contrast, mean = self._contrast(number, level, above)
        seen = self._sensitivity(number, mean)
        hidden = 1 + self._masking(number, seen * contrast)
        weight = share / share.sum(dtype=float)
        return _Band(contrast, (seen**POWER * weight / hidden).astype(np.float32))

    def _contrast(self, number: int, level: Array32, above: Array32) -> tuple[Array32, Array32]:
        """Contrast (3, h, w) of a level, and its local mean (h, w)."""
        smooth = self._levels.expanded(number, above)
        mean = np.maximum(smooth[0], np.float32(DARKEST_MEAN) / self._white)
        return (level - smooth) / mean, mean

    def _sensitivity(self, number: int, mean: Array32) -> Array32:
        """(3, h, w), the root of the mean square over the seats; bands below the first count twice."""
        where, curves = np.log(mean * self._white), _curves(self._levels.frequency(number))
        found = [np.interp(where, LOG_NITS, curve) * (2 if number else 1) for curve in curves]
        return np.array(found, np.float32)

    def _masking(self, number: int, seen: Array32) -> Array32:
        """How much the visible contrast (3, h, w) of the target hides errors."""
        blurred = [MASKING * self._levels.blurred(number, np.abs(plane)) for plane in seen]
        powers = [b ** np.float32(q) for b, q in zip(blurred, EXPONENTS, strict=True)]
        return mixed_channels(CROSS_CHANNEL.T, np.array(powers))

    def value(self, picture: Array32) -> float:
        """J of a picture (3, H, W)."""
        planes = self._levels_of(picture)
        return sum(
            self._errors(number, band, planes[number], planes[number + 1])[0]
            for number, band in enumerate(self._bands)
        )

    def of(self, picture: Array32) -> tuple[float, Array32]:
        """J and its slope (3, H, W) over the light of a picture (3, H, W)."""
        planes = self._levels_of(picture)
        total, slopes = 0.0, [np.zeros_like(level) for level in planes]
        for number, band in enumerate(self._bands):
            found = self._errors(number, band, planes[number], planes[number + 1])
            fine, coarse = self._slopes(*found[1:])
            total += found[0]
            slopes[number] += fine
            slopes[number + 1] += self._levels.expanded_adjoint(number, coarse)
        for number in reversed(range(len(self._levels))):
            slopes[number] += self._levels.reduced_adjoint(number, slopes[number + 1])
        return total, mixed_channels(DKL_FROM_RGB.T, slopes[0])

    def _levels_of(self, picture: Array32) -> list[Array32]:
        planes = [_opponent(picture)]
        for number in range(len(self._levels)):
            planes.append(self._levels.reduced(number, planes[-1]))
        return planes

    def _errors(
        self, number: int, band: _Band, level: Array32, above: Array32
    ) -> tuple[float, Array32, Array32, Array32]:
        """J of a band, its slope over contrast but for a factor, the contrast and the local mean."""
        contrast, mean = self._contrast(number, level, above)
        error = contrast - band.contrast
        slope = band.weight * error * np.sqrt(np.abs(error))
        return float(np.vdot(slope, error)), slope, contrast, mean

    def _slopes(self, slope: Array32, contrast: Array32, mean: Array32) -> tuple[Array32, Array32]:
        """Slopes of a band over the level and over the smoothed level."""
        fine = slope * (np.float32(POWER) / mean)
        coarse = -fine
        above_floor = mean > np.float32(DARKEST_MEAN) / self._white
        coarse[0] -= np.where(above_floor, (fine * contrast).sum(axis=0), 0)
        return fine, coarse


@cache
def _curves(frequency: float) -> Array:
    """Sensitivity (3, `CURVE_POINTS`) over `LOG_NITS` at a frequency [cycles per degree]."""
    seats = [
        [sensitivity(channel, frequency * seat, np.exp(LOG_NITS)) for seat in SEATS]
        for channel in range(3)
    ]
    gains = (GAINS * CHROMA_KEPT)[:, None]
    return np.asarray(gains * np.sqrt(np.mean(np.square(seats), axis=1)))


def _opponent(picture: Array32) -> Array32:
    return mixed_channels(DKL_FROM_RGB, picture)


def mixed_channels(matrix: FloatArray, planes: Array32) -> Array32:
    """A matrix (D, C) times planes (C, ...), in parts too small for BLAS to start threads that wait."""
    flat = np.ascontiguousarray(planes).reshape(len(planes), -1)
    single, mixed = matrix.astype(np.float32), np.empty((len(matrix), flat.shape[1]), np.float32)
    for start in range(0, flat.shape[1], COLUMNS):
        part = slice(start, start + COLUMNS)
        np.matmul(single, flat[:, part], out=mixed[:, part])
    return mixed.reshape(-1, *planes.shape[1:])


class Guard:
    """P: errors of the light itself, on a scale on which steps are about equally visible."""

    def __init__(self, target: Array32, weight: Array32, white_nits: float) -> None:
        self.target, self.weight, self._white = target, weight, np.float32(white_nits)
        self._wanted = pu21_table()(self._nits(target))[0]

    def _nits(self, picture: Array32) -> Array32:
        return np.concatenate([luma(picture)[None], picture]) * self._white

    def of(self, picture: Array32) -> tuple[float, Array32]:
        """P [units squared] and its slope (3, H, W) over the light of a picture (3, H, W)."""
        value, slope = pu21_table()(self._nits(picture))
        error = value - self._wanted
        weighted = error * self.weight
        weighted[1:] *= np.float32(COLOURS)
        total = float(np.vdot(weighted, error))
        slope *= weighted * (2 * self._white)
        return total, slope[1:] + np.multiply.outer(LUMA, slope[0])


def luma(picture: Array32) -> Array32:
    """Luminance (H, W) of a picture (3, H, W), that of white being 1."""
    return mixed_channels(LUMA[None], picture)[0]
