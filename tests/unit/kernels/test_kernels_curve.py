"""Curves in pieces against the transfer functions that they stand for."""

from collections.abc import Callable

import numpy as np
import pytest

from procam.errors import InputError
from procam.kernels.native.curve import Curve, encoding
from procam.maths.light.transfer import TRANSFER_NAMES, transfer

ROOT = 6e-5  # by how much AVX-512's roots are off


def evaluated(curve: Curve, x: np.ndarray) -> np.ndarray:
    """A curve as C evaluates it, in single precision."""
    shifted = x.astype(np.float32) + np.float32(curve.shift)
    number = shifted.view(np.uint32) >> 23 & 7
    value = np.zeros_like(shifted)
    for coefficients in curve.pieces[::-1]:
        value = value * shifted + coefficients[number]
    return value


@pytest.mark.parametrize("name", TRANSFER_NAMES)
def test_code_of_any_light(name: str) -> None:
    encode = transfer(name).encode
    light = np.concatenate([[0], np.geomspace(1e-10, 1, 5000), np.linspace(0.9, 1, 500)])
    root = np.sqrt(light) * (1 + ROOT * np.resize([0, 1, -1], light.shape))
    off = evaluated(encoding(encode), root) - 255 * encode(light)
    assert abs(off[0]) < 1e-4  # black stays black under any dither
    assert np.abs(off).max() < 0.2
    assert np.abs(off[light > 1e-4]).max() < 0.035


@pytest.mark.parametrize("encode", [lambda light: light > 0.3, np.cbrt])
def test_no_smooth_curve(encode: Callable) -> None:
    with pytest.raises(InputError, match="encode: smooth pieces miss it by"):
        encoding(encode)
