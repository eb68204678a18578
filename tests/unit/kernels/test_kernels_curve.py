"""Curves in pieces against the transfer functions that they stand for."""

import numpy as np
import pytest

from procam.kernels.native.curve import Curve, encoding
from procam.maths.light.transfer import TRANSFER_NAMES, transfer


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
    off = evaluated(encoding(encode), np.sqrt(light)) - 255 * encode(light)
    assert abs(off[0]) < 1e-4  # black stays black under any dither
    assert np.abs(off).max() < 0.2
    assert np.abs(off[light > 1e-4]).max() < 0.025
