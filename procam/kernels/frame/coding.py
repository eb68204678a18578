"""Coding of light in pictures, for the frame kernels: decoding, encoding, dither, strength."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from procam.arrays import AnyArray, Array, FloatArray, Map
from procam.kernels.frame.grid import CHANNELS
from procam.kernels.native.arrays import aligned_like, numbers

Curve = Callable[[FloatArray], FloatArray]
WHOLE = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0}
SEGMENTS, TILE = 32, 64  # as in frame/values.h
FITTED = 16  # samples of a curve for each parabola


@dataclass(frozen=True, eq=False)
class Coding:
    """How the values of a picture encode light, and how results are written.

    Attributes
    ----------
    decode, encode : of values 0..1; used for uint8 only, other types are linear.
    threshold : (64, 64) in 0..1, for the rounding of uint8: floor(value + threshold).
    strength : 0 gives the picture itself, 1 the full result, mixed as encoded.
    top : the most light to send anywhere [rel].
    """

    decode: Curve
    encode: Curve
    threshold: Map
    strength: float = 1.0
    top: float = np.inf
    tables: dict[str, AnyArray] = field(init=False)

    def __post_init__(self) -> None:
        codes = np.asarray(self.decode(np.arange(256) / 255), np.float32)
        numbers(codes, (256,), "decode")
        numbers(self.threshold, (TILE, TILE), "threshold")
        tile = np.repeat(self.threshold, CHANNELS, axis=1)
        tables = {
            "decode": codes,
            "decode_bytes": aligned_like(np.empty((4, 256), np.uint8)),
            "encode": _pieces(self.encode),
            "threshold": np.ascontiguousarray(tile, np.float32),
        }
        tables["decode_bytes"][...] = codes.view(np.uint8).reshape(256, 4).T
        object.__setattr__(self, "tables", tables)

    def most(self, dtype: np.dtype[Any]) -> float:
        """The most light that pictures of a type can send."""
        return min(self.top, 1.0) if dtype == np.uint8 else self.top

    def decoded(self, picture: AnyArray) -> AnyArray:
        """Linear light of a picture's values; what is not finite is black."""
        if picture.dtype == np.uint8:
            return np.take(self.tables["decode"], picture)
        return np.where(np.isfinite(picture), picture, 0) / WHOLE.get(picture.dtype, 1.0)

    def encoded(self, light: Array, picture: AnyArray, rows: slice) -> AnyArray:
        """Values to write for `light` (R, N, 3), mixed with those of the picture."""
        whole = WHOLE.get(picture.dtype)
        value = light if whole is None else whole * np.clip(light, 0, 1)
        if picture.dtype == np.uint8:
            value = np.asarray(255 * self.encode(np.clip(light, 0, 1)), float)
        if self.strength < 1:
            came = np.where(np.isfinite(picture), picture, 0)
            value = came + self.strength * (value - came)
        if picture.dtype == np.uint8:
            y = np.arange(rows.start, rows.stop) % TILE
            x = np.arange(light.shape[1]) % TILE
            value = np.floor(np.minimum(value + self.threshold[np.ix_(y, x)][..., None], 255))
        return value if whole is None else np.rint(value)


def _pieces(encode: Curve) -> Map:
    """255 encode(x) as parabolas (3, SEGMENTS) of the root of x, two per octave of it, from 0 at 2^-15.

    Bits of the root as float32, from the 22nd on, number them modulo SEGMENTS. Each has the least squared
    error at Chebyshev's points, where cosines are orthogonal.
    """
    bits = (7 * SEGMENTS + np.arange(SEGMENTS + 1)).astype(np.uint32) << 22
    edges = bits.view(np.float32).astype(float)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    turn = np.pi * (np.arange(FITTED) + 0.5) / FITTED
    root = middle[:, None] + half[:, None] * np.cos(turn)
    value = 255 * np.asarray(encode(np.minimum(root**2, 1)))
    mean, rise, bend = ((value * np.cos(k * turn)).mean(axis=1) for k in range(3))
    second, first = 4 * bend / half**2, 2 * rise / half
    found = np.stack([mean - 2 * bend, first, second])
    found[0] += (second * middle - first) * middle
    found[1] -= 2 * second * middle
    end = edges[1]
    found[:, 0] = 255 * encode(end**2) / (end - edges[0]) * np.array([-edges[0], 1, 0])
    return np.ascontiguousarray(found, np.float32)
