"""Smooth curves as the C kernels evaluate them: a polynomial for each octave of a shifted argument."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Array32, FloatArray
from procam.errors import InputError
from procam.kernels.native.arrays import numbers

OCTAVES, PIECES = 8, 16  # each octave is there twice, as in native/vector.h
DECODE_DEGREE, ENCODE_DEGREE = 4, 3
CODES = np.arange(256.0)
# The bend of sRGB (IEC 61966-2-1) lies between two octaves of a code, and of a root of light, so shifted;
# the others suit curves without a bend.
DECODE_SHIFTS = 16 - 0.04045 * 255, 0.0
ENCODE_SHIFTS = 2.0**-4 - 0.0031308**0.5, 2.0**-7
SAMPLES = 2000
ROUNDING = 1e-6  # singular values below it would make large coefficients that cancel, in single precision
CLOSE = 1e-5  # of the light of a code, or of code 1


@dataclass(frozen=True, slots=True)
class Curve:
    """Polynomials of x + shift, x >= 0, numbered by the binary exponent of that modulo 8.

    Attributes
    ----------
    pieces : (degree + 1, PIECES), constants first.
    """

    shift: float
    pieces: Array32


def decoding(light: Array) -> Curve:
    """Light of codes 0..255, given (256,), to CLOSE of it.

    Raises
    ------
    ShapeError, InputError
        Other shapes; light that does not rise as smoothly as a transfer function.
    """
    known = numbers(light, CODES.shape, "decode")
    weight = 1 / np.maximum(np.abs(known), max(abs(float(known[1])), 1e-9))
    curve, error = _fitted(CODES, known, weight, DECODE_DEGREE, DECODE_SHIFTS)
    if not error < CLOSE:
        raise InputError(
            f"decode: a smooth curve misses the light of a code by {error:.2g} of it; give a transfer "
            "function, one curve from black to white with at most the bend of sRGB"
        )
    return curve


def encoding(encode: Callable[[FloatArray], FloatArray]) -> Curve:
    """255 encode(x^2), of the root x of the light; exact for black, elsewhere to a fifth of a code."""
    fits = []
    for shift in ENCODE_SHIFTS:
        root = np.geomspace(shift, 1 + shift, SAMPLES) - shift
        value = 255 * np.asarray(encode(np.clip(root, 0, 1) ** 2), float)
        weight = np.where(root > 0, 1.0, SAMPLES)
        fits.append(_fitted(root, value, weight, ENCODE_DEGREE, (shift,)))
    return min(fits, key=lambda fit: fit[1])[0]


def _fitted(
    x: Array, y: Array, weight: Array, degree: int, shifts: tuple[float, ...]
) -> tuple[Curve, float]:
    """The curve of least weighted squares, of the best shift, and its largest weighted error."""
    fits = [(shift, *_pieces(x + shift, y, weight, degree)) for shift in shifts]
    shift, pieces, error = min(fits, key=lambda fit: fit[2])
    return Curve(shift, pieces), error


def _pieces(x: Array, y: Array, weight: Array, degree: int) -> tuple[Array32, float]:
    number = x.astype(np.float32).view(np.uint32) >> 23 & (OCTAVES - 1)
    pieces, error = np.zeros((degree + 1, OCTAVES)), 0.0
    for n in np.unique(number):
        mine = number == n
        powers = x[mine, None] ** np.arange(degree + 1)
        scale = powers.max(axis=0)
        rows = powers / scale * weight[mine, None]
        pieces[:, n] = np.linalg.lstsq(rows, y[mine] * weight[mine], ROUNDING)[0] / scale
        off = weight[mine] * (powers @ pieces[:, n] - y[mine])
        error = max(error, float(np.abs(off).max()))
    return np.tile(pieces, (1, PIECES // OCTAVES)).astype(np.float32), error
