"""Content of any type for the frame kernels, and their results as content of that type."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from procam.arrays import AnyArray, BoolArray, Image
from procam.kernels.frame.coding import WHOLE, Coding
from procam.maths.codes.dither import TILE, dithered, threshold_tile
from procam.maths.light.transfer import Transfer, transfer
from procam.maths.log_table import LogTable

DARKEST = 1e-7  # light [rel] below which its code is 0 for 8 bits


@dataclass(frozen=True)
class ContentCodec:
    """How content is decoded and results are encoded.

    8-bit content and linear content go to the kernels as they are, with a `Coding`. Other content is
    decoded here first, and results are encoded here afterwards.

    Attributes
    ----------
    transfer : of the content; None: srgb for integers, linear for floats.
    strength : of the compensation, 0 to 1.
    protected : (N, N) where content is sent unchanged, or None.
    top : the most light that floats send [rel]; integers end at 1.
    """

    transfer: Transfer | None
    strength: float
    protected: BoolArray | None
    top: float = np.inf
    _codings: dict[tuple[str, float, float], Coding] = field(default_factory=dict)
    _tables: dict[Coding, LogTable] = field(default_factory=dict)

    def decoded(self, image: AnyArray, most: Image | None = None) -> tuple[AnyArray, Coding]:
        """The content for the kernels: 8 bits as they are, other types in linear light.

        Floats are at most `most` (N, N, 3), if it is given; what is not finite stays black.
        """
        integer = image.dtype in WHOLE
        most = None if integer else most
        name, top = self._encoding(image)
        if image.dtype == np.uint8 or (name == "linear" and most is None):
            return image, self.coding(name, top, self.strength)
        return self.linear(image, most)

    def linear(self, image: AnyArray, most: Image | None = None) -> tuple[Image, Coding]:
        """The content in linear light, of any type; its coding encodes what comes of it."""
        name, top = self._encoding(image)
        if image.dtype == np.uint8:
            return self.coding(name, top, 1.0).decoded(image), self.coding(name, top, 1.0)
        value = image.astype(np.float32) / np.float32(WHOLE.get(image.dtype, 1))
        light = transfer(name).decode(value).astype(np.float32)
        if most is not None:
            light = np.where(np.isfinite(light), np.minimum(light, most), np.float32(0))
        return light, self.coding(name, top, 1.0)

    def _encoding(self, image: AnyArray) -> tuple[str, float]:
        """Transfer function of an image, and the most light to send."""
        integer = image.dtype in WHOLE
        name = self.transfer.name if self.transfer else "srgb" if integer else "linear"
        return name, 1.0 if integer else self.top

    def coding(self, name: str, top: float, strength: float) -> Coding:
        """The coding for a transfer function, the most light to send [rel] and a strength."""
        key = name, top, strength
        if key not in self._codings:
            known = transfer(name)
            made = Coding(known.decode, known.encode, threshold_tile(), strength, top)
            self._codings[key] = made
        return self._codings[key]

    def protected_pixels(self, image: AnyArray) -> AnyArray | None:
        """Values of an image where content is sent unchanged, or None."""
        return None if self.protected is None else image[self.protected]

    def finished(
        self,
        image: AnyArray,
        sent: AnyArray,
        coding: Coding | None,
        out: AnyArray | None,
        held: AnyArray | None,
    ) -> AnyArray:
        """Light encoded as the image is, by `coding` unless it is so already; protected pixels put back."""
        if coding is not None:
            light, sent = sent, np.empty_like(image) if out is None else out
            for start in range(0, len(image), TILE):  # what lies between stays in the cache
                rows = slice(start, start + TILE)
                sent[rows] = self._mixed(image[rows], light[rows], coding)
        if held is not None:
            sent[self.protected] = held
        return sent

    def _mixed(self, image: AnyArray, light: AnyArray, coding: Coding) -> AnyArray:
        """Rows of an image, mixed with light by the strength: 8 bits are dithered, 16 rounded."""
        whole = WHOLE.get(image.dtype)
        value = self._encoded(coding, light, image.dtype) * np.float32(whole or 1)
        if self.strength < 1:
            came = image if whole else np.where(np.isfinite(image), image, 0)
            value = (1 - self.strength) * came + self.strength * value
        if image.dtype == np.uint8:
            return dithered(value)
        return (np.rint(value) if whole else value).astype(image.dtype)

    def _encoded(self, coding: Coding, light: AnyArray, dtype: np.dtype[Any]) -> AnyArray:
        """Encoded light; for 8 bits by a table, right to a hundredth of a code."""
        if dtype != np.uint8:
            return np.asarray(coding.encode(light))
        if coding not in self._tables:
            self._tables[coding] = LogTable(lambda x: np.asarray(coding.encode(x)), DARKEST, 1.0)
        return self._tables[coding](light)[0]
