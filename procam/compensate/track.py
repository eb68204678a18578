"""Exact compensation for a player: textures, uniforms, and a few coefficients per frame.

Per colour, scattered light is `spread` times a polynomial of nine terms in the direction
(compensate.fields). The coefficients of the polynomial are all that differs from frame to frame.
"""

from collections.abc import Sequence

import numpy as np

from procam.arrays import Array, Image
from procam.compensate.fields import Fields
from procam.maths.codes.dither import threshold_tile

TERMS = ("1", "x", "y", "z", "xy", "yz", "xz", "x^2-y^2", "z^2")
CHANNELS = "RGB"
METHODS = ("exact", "subtract")  # those whose frames differ in the coefficients alone
EXPONENTS = {"gamma2.2": 2.2, "gamma2.4": 2.4, "gamma2.6": 2.6, "bt1886": 2.4}
NO_LIMIT = 1e30  # a number that JSON and a shader can both hold


def textures(fields: Fields) -> dict[str, Image]:
    """Textures (H, W, 1 or 3) by name; a uniform field is one texel.

    Floats of 32 bits: near black a step of 8-bit sRGB is 3e-4 of white, and half floats would round the
    scattered light by up to half of that.
    """
    model = fields.shown
    found = {
        "spread": model.spread,
        "lo": model.lo,
        "hi": _texel(NO_LIMIT, 3) if model.hi is None else model.hi,
        "ambient": _texel(0, 3) if model.ambient is None else model.ambient,
        "gain": _texel(1) if model.gain is None else model.gain,
        "coverage": model.coverage,
        "protection": _texel(0) if fields.protected is None else fields.protected,
        "dither": threshold_tile(),
    }
    return {name: np.asarray(np.atleast_3d(field), np.float32) for name, field in found.items()}


def _texel(value: float, channels: int = 1) -> Image:
    return np.full((1, 1, channels), value, np.float32)


def columns(used: int) -> list[str]:
    """Names of a row's coefficients: the three colours of the first term, of the second, and so on.

    A bare sphere has one term, a furnished dome four or nine (`FrameModel.terms`).

    >>> columns(1)
    ['1.R', '1.G', '1.B']
    """
    return [f"{term}.{channel}" for term in TERMS[:used] for channel in CHANNELS]


def row(coefficients: Array, used: int) -> Sequence[float]:
    """The coefficients (3, 9) of a frame in the order of `columns`."""
    return [float(value) for value in coefficients[:, :used].T.ravel()]


def uniforms(transfer: str, dtype: np.dtype[np.generic]) -> dict[str, float]:
    """Uniforms that do not change: the transfer function, and the range of a target of `dtype`.

    >>> uniforms("bt1886", np.dtype(np.uint8))
    {'transfer': 2, 'exponent': 2.4, 'top': 1.0, 'levels': 255.0}
    """
    whole = np.issubdtype(dtype, np.integer)
    return {
        "transfer": {"linear": 0, "srgb": 1}.get(transfer, 2),
        "exponent": EXPONENTS.get(transfer, 1.0),
        "top": 1.0 if whole else NO_LIMIT,
        "levels": 255.0 if dtype == np.uint8 else 0.0,
    }


def moves(fields: Fields) -> Image:
    """(18, 9, 3) for the live variant: coefficients q become A M + B q, M the moments that q gives.

    Without limits M = M_t - S q, S the moments of the terms weighted with `spread`, and q = G M
    (`Fields.operator`) is solved by Newton's step q + J (G M - q), J = (I + G S)^-1. Where limits hold
    the step is too short, but by no more than their share of the scattered light. Rows 0..8 are
    A = J G, rows 9..17 are B = I - J, columns the term they apply to.
    """
    used, count = fields.model.terms, len(TERMS)
    found = np.zeros((2 * count, count, 3), np.float32)
    for c in range(3):
        scattered = np.eye(used) + fields.operator[c] @ fields.spread_gram[c]
        found[:used, :used, c] = np.linalg.solve(scattered, fields.operator[c])
        found[count : count + used, :used, c] = np.eye(used) - np.linalg.inv(scattered)
    return found
