"""Pyramids of pictures, each level half the one below, and the adjoints of their steps.

Planes are (C, h, w) in single precision. The filter is (1 4 6 4 1) / 16 both ways, over the pixels of a mask
alone: what lies outside, or beyond the border, does not count as black.
"""

import numpy as np

from procam.arrays import Array32
from procam.maths.warp import blur, filter_in_dark

KERNEL = np.array([1, 4, 6, 4, 1], np.float32) / 16
PEAK = 0.3228  # of the Nyquist frequency: where a band passes most, twice that of its level
LOWEST = 0.1  # cycles per degree
SMALLEST = 8  # px
REACH_PX = 3.0  # of masking
FAINT = 1e-3  # of a filter's weight: less inside is no mean


class Pyramid:
    """Steps between the levels of pictures of one shape.

    Parameters
    ----------
    mask : (H, W), 1 where a picture counts, else 0. pixels_per_degree : at the eyepoint.
    """

    def __init__(self, mask: Array32, pixels_per_degree: float) -> None:
        self._pixels_per_degree = pixels_per_degree
        self._masks, self._down, self._up = [mask], list[Array32](), list[Array32]()
        while not self._down or self._continues():
            fine = self._masks[-1]
            inside = _halved(fine)
            coarse = (inside > FAINT).astype(np.float32)
            self._down.append(_inverse(inside))
            self._up.append(_inverse(_doubled(coarse, fine.shape)))
            self._masks.append(coarse)

    def _continues(self) -> bool:
        """Whether the last level has pixels enough, and lies above what sensitivity is known for."""
        return min(self._masks[-1].shape) >= SMALLEST and self.frequency(len(self) - 1) > LOWEST

    def __len__(self) -> int:
        return len(self._down)

    def frequency(self, level: int) -> float:
        """What is lost from a level to the next [cycles per degree], by the peak of the filters."""
        return self._pixels_per_degree / 2 * (PEAK * 0.5**level if level else 1)

    def blurred(self, level: int, plane: Array32) -> Array32:
        """A plane (h, w) over the reach of masking."""
        return blur(plane * self._masks[level], REACH_PX)

    def reduced(self, level: int, planes: Array32) -> Array32:
        """From a level to the next coarser one (C, ceil(h/2), ceil(w/2))."""
        mask, scale = self._masks[level], self._down[level]
        return np.stack([_halved(plane * mask) * scale for plane in planes])

    def expanded(self, level: int, planes: Array32) -> Array32:
        """Back to a level from the next coarser one."""
        mask, scale = self._masks[level + 1], self._up[level]
        return np.stack([_doubled(plane * mask, scale.shape) * scale for plane in planes])

    def reduced_adjoint(self, level: int, slope: Array32) -> Array32:
        """Adjoint of `reduced`: from slopes at the next coarser level to a level's."""
        mask, scale = self._masks[level], self._down[level]
        return np.stack([_doubled(plane * scale, mask.shape) * mask for plane in slope])

    def expanded_adjoint(self, level: int, slope: Array32) -> Array32:
        """Adjoint of `expanded`."""
        mask, scale = self._masks[level + 1], self._up[level]
        return np.stack([_halved(plane * scale) * mask for plane in slope])


def _halved(plane: Array32) -> Array32:
    return filter_in_dark(plane, KERNEL)[::2, ::2]


def _doubled(plane: Array32, shape: tuple[int, ...]) -> Array32:
    """Adjoint of `_halved`: the filter is symmetric."""
    spaced = np.zeros(shape, np.float32)
    spaced[::2, ::2] = plane
    return filter_in_dark(spaced, KERNEL)


def _inverse(weight: Array32) -> Array32:
    return np.where(weight > FAINT, 1 / np.maximum(weight, np.float32(FAINT)), np.float32(0))
