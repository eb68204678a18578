"""Types and transfer functions of frames: what they are written as, and their linear light."""

from typing import Any

import numpy as np

from procam.arrays import AnyArray, Array32
from procam.maths.light.transfer import transfer


def output_encoding(dtype: np.dtype[Any], named: str, suffix: str) -> tuple[np.dtype[Any], str]:
    """Type and transfer function of the output for pixels of a type, encoded as `named`.

    As they came, but EXR takes light (from integers: linear float) and PNG takes integers (from
    linear light: 16-bit sRGB).

    >>> output_encoding(np.dtype(np.uint8), "srgb", ".exr")
    (dtype('float32'), 'linear')
    """
    if suffix == ".exr" and dtype.kind != "f":
        return np.dtype(np.float32), "linear"
    if suffix == ".png" and dtype.kind == "f":
        return np.dtype(np.uint16), "srgb" if named == "linear" else named
    return dtype, named


def recoded(rgb: AnyArray, named: str, dtype: np.dtype[Any], out: str) -> AnyArray:
    """Encoded colours in another type and transfer function; integers clip at 1."""
    if rgb.dtype == dtype and named == out:
        return rgb
    light = decoded(rgb, named)
    encoded = light if out == "linear" else transfer(out).encode(np.clip(light, 0, 1))
    if dtype.kind == "f":
        return np.asarray(encoded, dtype)
    top = np.iinfo(dtype).max
    return np.rint(np.clip(encoded, 0, 1) * np.float32(top)).astype(dtype)


def decoded(rgb: AnyArray, named: str) -> Array32:
    """Linear light (N, N, 3) of encoded colours."""
    peak = 1 if rgb.dtype.kind == "f" else np.iinfo(rgb.dtype).max
    share = np.asarray(rgb, np.float32) / np.float32(peak)
    return share if named == "linear" else np.asarray(transfer(named).decode(share), np.float32)
