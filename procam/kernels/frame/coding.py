"""Coding of light in pictures, for the frame kernels: decoding, encoding, dither, strength."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from procam.arrays import AnyArray, Array, FloatArray, Map
from procam.errors import InputError
from procam.kernels.frame.grid import CHANNELS
from procam.kernels.native.arrays import bytes_of_floats, numbers
from procam.kernels.native.curve import Curve, encoding

Transfer = Callable[[FloatArray], FloatArray]
WHOLE = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0}
BLACK = 1e-4  # of full scale: what light 0 may be coded as
TILE = 64  # as in frame/values.h


@dataclass(frozen=True, eq=False)
class Coding:
    """How the values of a picture encode light, and how results are written.

    Attributes
    ----------
    decode, encode : of values 0..1; used for uint8 only, other types are linear.
    threshold : (64, 64) in 0..1, for the rounding of uint8: floor(value + threshold).
    strength : 0 gives the picture itself, 1 the full result, mixed as encoded.
    top : the most light to send anywhere [rel].
    codes : (256,) light of each code [rel].
    """

    decode: Transfer
    encode: Transfer
    threshold: Map
    strength: float = 1.0
    top: float = np.inf
    codes: Map = field(init=False)

    def __post_init__(self) -> None:
        numbers(self.threshold, (TILE, TILE), "threshold")
        codes = numbers(self.decode(np.arange(256) / 255), (256,), "decode")
        object.__setattr__(self, "codes", codes.astype(np.float32))
        black = float(self.encode(np.zeros(1))[0])
        if not abs(black) < BLACK:
            raise InputError(f"encode: light 0 is coded as {black:.3g}; black must be code 0")

    @cached_property
    def curve(self) -> Curve:
        """`encode` as C evaluates it."""
        return encoding(self.encode)

    @cached_property
    def in_c(self) -> dict[str, AnyArray]:
        """Arrays of the C struct, for uint8."""
        return {
            "decode": self.codes,
            "decode_bytes": bytes_of_floats(self.codes),
            "encode": self.curve.pieces,
            "threshold": np.ascontiguousarray(
                np.repeat(self.threshold, CHANNELS, axis=1), np.float32
            ),
        }

    def most(self, dtype: np.dtype[Any]) -> float:
        """The most light that pictures of a type can send."""
        return min(self.top, 1.0) if dtype == np.uint8 else self.top

    def decoded(self, picture: AnyArray) -> AnyArray:
        """Linear light of a picture's values; what is not finite is black."""
        if picture.dtype == np.uint8:
            return np.take(self.codes, picture)
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
