"""Smooth curves as the C kernels evaluate them: a polynomial for each octave of a shifted argument."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array32, FloatArray
from procam.errors import InputError

OCTAVES, PIECES = 8, 16  # each octave is there twice, as in native/vector.h
POWERS = np.arange(4)
# The bend of sRGB (IEC 61966-2-1) lies between two octaves of a root of light so shifted; the other
# shift suits curves without a bend. Both reach a little into a ninth octave, where curves are straight
# enough to share the cubic of the first.
SHIFTS = 2.0**-4 - 0.0031308**0.5, 2.0**-7
SAMPLES = 1000
CLOSE = 0.25  # codes
ROUNDING = 1e-6  # singular values below it would make coefficients that cancel, in single precision


@dataclass(frozen=True, slots=True)
class Curve:
    """Polynomials of x + shift, x >= 0, numbered by the binary exponent of that modulo 8.

    Attributes
    ----------
    pieces : (4, PIECES), constants first.
    """

    shift: float
    pieces: Array32


def encoding(encode: Callable[[FloatArray], FloatArray]) -> Curve:
    """255 encode(x^2), of the root x of the light; exact for black, elsewhere to CLOSE.

    Raises
    ------
    InputError
        For a curve that cubics do not follow.
    """
    curve, error = min((_fitted(encode, shift) for shift in SHIFTS), key=lambda fit: fit[1])
    if not error < CLOSE:
        raise InputError(
            f"encode: smooth pieces miss it by {error:.2g} codes; give a transfer function, one curve from "
            "black to white with at most the bend of sRGB"
        )
    return curve


def _fitted(encode: Callable[[FloatArray], FloatArray], shift: float) -> tuple[Curve, float]:
    """The curve of least weighted squares, and its largest weighted error."""
    x = np.geomspace(shift, 1 + shift, SAMPLES)
    root = x - shift
    value = 255 * np.asarray(encode(np.clip(root, 0, 1) ** 2), float)
    weight = np.where(root > 0, 1.0, SAMPLES)
    number = x.astype(np.float32).view(np.uint32) >> 23 & (OCTAVES - 1)
    pieces, error = np.zeros((len(POWERS), OCTAVES)), 0.0
    for n in set(number.tolist()):
        mine = number == n
        powers = x[mine, None] ** POWERS
        scale = powers.max(axis=0)
        rows = powers / scale * weight[mine, None]
        pieces[:, n] = np.linalg.lstsq(rows, value[mine] * weight[mine], ROUNDING)[0] / scale
        off = weight[mine] * (powers @ pieces[:, n] - value[mine])
        error = max(error, float(np.abs(off).max()))
    return Curve(shift, np.tile(pieces, (1, PIECES // OCTAVES)).astype(np.float32)), error
