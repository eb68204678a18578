"""Curves in pieces against the transfer functions that they stand for."""

import numpy as np
import pytest

from procam.errors import InputError, ShapeError
from procam.kernels.native.curve import CODES, Curve, decoding, encoding
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
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_light_of_each_code(name: str, kind: type) -> None:
    light = transfer(name).decode(CODES / 255)
    found = evaluated(decoding(light.astype(kind)), CODES)
    np.testing.assert_allclose(found[1:], light[1:], rtol=1e-5)
    assert abs(found[0]) < 1e-5 * light[1]


@pytest.mark.parametrize("name", TRANSFER_NAMES)
def test_code_of_any_light(name: str) -> None:
    encode = transfer(name).encode
    light = np.concatenate([[0], np.geomspace(1e-10, 1, 5000), np.linspace(0.9, 1, 500)])
    off = evaluated(encoding(encode), np.sqrt(light)) - 255 * encode(light)
    assert abs(off[0]) < 1e-4  # black stays black under any dither
    assert np.abs(off).max() < 0.2
    assert np.abs(off[light > 1e-4]).max() < 0.025


@pytest.mark.parametrize("bad", [CODES > 128, (CODES / 255) ** 2 + (CODES == 90) * 1e-3])
def test_no_smooth_curve(bad: np.ndarray) -> None:
    with pytest.raises(InputError, match="decode: a smooth curve misses the light of a code by"):
        decoding(np.asarray(bad, float))


def test_another_number_of_codes() -> None:
    with pytest.raises(ShapeError, match=r"decode has shape \(255,\)"):
        decoding(CODES[1:])
