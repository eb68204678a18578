"""Photographs of codes of other programs: patterns and camera share nothing with procam's decoders.

Patterns are drawn on a grid four times finer than the panel, blurred, and photographed at the
places where a tilted, slightly curved screen shows them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

SIZE = (192, 128)
CAMERA = (150, 190)
FINE = 4
READ_DN, GAIN = 3.0, 0.08  # noise: read, and photons as variance per count
PEDESTAL, WHITE_DN = 64.0, 2600.0
INSIDE_PX = 8.0


@dataclass(frozen=True)
class Set:
    """Photographs in the order they were taken, and the columns and rows (H, W) that they show."""

    photographs: list[np.ndarray]
    truth: np.ndarray

    def inside(self) -> np.ndarray:
        """Pixels clear of the panel's border."""
        x, y = self.truth[..., 0], self.truth[..., 1]
        return (
            (x > INSIDE_PX)
            & (y > INSIDE_PX)
            & (x < SIZE[0] - 1 - INSIDE_PX)
            & (y < SIZE[1] - 1 - INSIDE_PX)
        )


def steps(period: float, count: int) -> list[np.ndarray]:
    """Equal steps of a cosine along columns 0, 1, ... (as many as the longest side), 0 to 1."""
    x = np.arange(max(SIZE))
    return [0.5 * (1 + np.cos(2 * np.pi * (x / period - n / count))) for n in range(count)]


def gray(length: int, cell: int) -> list[np.ndarray]:
    """Reflected binary patterns of cells, the coarsest first, by reflecting (not by exclusive or)."""
    words = [[0], [1]]
    while len(words) < -(-length // cell):
        words = [[0, *word] for word in words] + [[1, *word] for word in reversed(words)]
    return [line.astype(float) for line in np.array(words)[np.arange(length) // cell].T]


def view() -> np.ndarray:
    """Projector pixels (H, W, 2) at the centres of the camera's pixels."""
    v, u = np.mgrid[: CAMERA[0], : CAMERA[1]].astype(float)
    scale = 1 + 4e-4 * u - 2e-4 * v
    x = (1.05 * u + 0.12 * v - 9) / scale + 2e-4 * (v - 70) ** 2
    y = (0.88 * v - 0.08 * u + 6) / scale + 1e-4 * (u - 90) ** 2
    return np.stack([x, y], axis=-1)


def light_of(line: np.ndarray, axis: int, blur_px: float) -> np.ndarray:
    """Light (H, W) of one pattern, 0 to 1: blurred along the axis."""
    length = SIZE[axis]
    shown = np.concatenate([np.zeros(16), line[:length], np.zeros(16)])
    fine = gaussian_filter1d(np.repeat(shown, FINE), blur_px * FINE)
    place = (np.arange(fine.size) + 0.5) / FINE - 0.5 - 16
    return np.interp(view()[..., axis], place, fine, left=0, right=0)


def photograph(
    lines: Sequence[tuple[np.ndarray, int]],
    rng: np.random.Generator,
    *,
    blur_px: float = 1.0,
    exposures: Sequence[float] | None = None,
) -> Set:
    """12-bit photographs of patterns (line, axis), with paint, ambient light, scatter and noise."""
    truth = view()
    white = np.ones(max(SIZE))
    on = light_of(white, 0, blur_px) * light_of(white, 1, blur_px)
    paint = 0.75 + 0.2 * np.sin(truth[..., 0] / 23) * np.cos(truth[..., 1] / 31)
    taken = []
    for (line, axis), gain in zip(lines, exposures or [1.0] * len(lines), strict=True):
        other = light_of(white, 1 - axis, blur_px)
        direct = light_of(line, axis, blur_px) * other * (on > 0)
        flux = line[: SIZE[axis]].mean()
        signal = gain * WHITE_DN * paint * (0.01 + 0.85 * direct + 0.08 * flux)
        noisy = signal + rng.normal(size=signal.shape) * np.sqrt(READ_DN**2 + GAIN * signal)
        taken.append(np.clip(np.rint(PEDESTAL + noisy), 0, 4095).astype(np.uint16))
    return Set(taken, truth)
