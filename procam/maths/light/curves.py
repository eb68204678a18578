"""Monotone response curves as tables from drive to relative linear light, and sRGB."""

import numpy as np

from procam.arrays import Array, FloatArray


def apply_curve(drive: FloatArray, levels: Array, values: Array) -> Array:
    """Linear light (..., 3) of `drive` (..., 3), from tables `levels` (K,) and `values` (K, 3)."""
    return np.stack(
        [np.interp(drive[..., c], levels, values[:, c]) for c in range(values.shape[1])], axis=-1
    )


def invert_curve(linear: FloatArray, levels: Array, values: Array) -> Array:
    """Drive (..., 3) that gives `linear` (..., 3), clipped to the table; inverse of `apply_curve`."""
    return np.stack(
        [np.interp(linear[..., c], values[:, c], levels) for c in range(values.shape[1])], axis=-1
    )


def srgb_decode(encoded: FloatArray) -> FloatArray:
    """Linear light of sRGB-encoded values 0..1 (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def srgb_encode(linear: FloatArray) -> FloatArray:
    """Encode linear values 0..1 as sRGB; the inverse of `srgb_decode`."""
    positive = np.maximum(linear, 0.0)
    return np.where(positive <= 0.0031308, positive * 12.92, 1.055 * positive ** (1 / 2.4) - 0.055)
