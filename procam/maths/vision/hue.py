"""Differences of hue, as CIEDE2000 weighs them.

Sharma, Wu and Dalal (2005), "The CIEDE2000 color-difference formula" (doi:10.1002/col.20070): the term of hue
alone, so that lighter, darker, paler or stronger of one hue is no difference.
"""

import numpy as np

from procam.arrays import AnyArray, Array
from procam.maths.vision.contrast import XYZ_FROM_RGB

BRIGHT, SLOPE, SHIFT = 216 / 24389, 24389 / 27 / 116, 16 / 116  # of CIELAB
FAR = 25.0**7


def hue_difference(first: AnyArray, second: AnyArray) -> Array:
    """Hue difference (n,) of two lights (3, n) in linear sRGB, whose white is 1 [dE2000].

    >>> red = np.array([[0.3], [0.1], [0.1]])
    >>> hue_difference(red, 0.5 * red).round(2), hue_difference(red, red[::-1]).round(0)
    (array([0.]), array([26.]))
    """
    a, b = np.stack([_opponents(np.asarray(light, float)) for light in (first, second)], axis=1)
    mean = np.hypot(a, b).mean(axis=0) ** 7
    a = a * (1 + (1 - np.sqrt(mean / (mean + FAR))) / 2)
    chroma, angle = np.hypot(a, b), np.arctan2(b, a)
    turn = (angle[1] - angle[0] + np.pi) % (2 * np.pi) - np.pi
    middle = angle[0] + turn / 2
    scale = 1 + 0.015 * chroma.mean(axis=0) * _weight(middle)
    return np.asarray(np.abs(2 * np.sqrt(chroma.prod(axis=0)) * np.sin(turn / 2) / scale))


def _opponents(light: Array) -> Array:
    """CIELAB's a and b (2, n)."""
    ratio = np.maximum(XYZ_FROM_RGB @ light / XYZ_FROM_RGB.sum(axis=1)[:, None], 0)
    x, y, z = np.where(ratio > BRIGHT, np.cbrt(ratio), SLOPE * ratio + SHIFT)
    return np.stack([500 * (x - y), 200 * (y - z)])


def _weight(hue: Array) -> Array:
    """T of CIEDE2000 at a hue angle [rad]."""
    return np.asarray(
        1
        - 0.17 * np.cos(hue - np.radians(30))
        + 0.24 * np.cos(2 * hue)
        + 0.32 * np.cos(3 * hue + np.radians(6))
        - 0.20 * np.cos(4 * hue - np.radians(63))
    )
