"""Photographs of a structured-light code to projector coordinates, folded in as they arrive.

White and black come first; then each axis is decoded as soon as its last picture is in, so that
memory does not grow with the number of pictures.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError, NotEnoughData, ShapeError
from procam.estimate.structured_light.axis import AxisDecoder, AxisResult
from procam.estimate.structured_light.codes import AXES, Code, Plane
from procam.estimate.structured_light.defocus_bias import undo_blur
from procam.estimate.structured_light.limits import DecodeLimits, default_limits, dropped_samples
from procam.estimate.structured_light.outliers import drop_lonely
from procam.estimate.structured_light.sinusoids import SinusoidResult
from procam.model.correspondence import CorrespondenceMap

Samples = NDArray[Any]
Map = NDArray[np.float32]
CLIPPED_SHARE = 0.01


@dataclass(frozen=True)
class Decoded:
    """What a code told.

    Attributes
    ----------
    map : projector coordinates per camera pixel.
    direct : (H, W) the part of white - black that came straight; `scattered` the rest, after bounces.
    waves : what lens, response and noise were found to do, per axis with sinusoidal pictures.
    lost : pictures that nothing could be read from, and so were left out.
    notes : what was odd, one line each.
    """

    map: CorrespondenceMap
    direct: Map
    scattered: Map
    waves: dict[str, SinusoidResult] = field(default_factory=dict)
    lost: tuple[Plane, ...] = ()
    notes: tuple[str, ...] = ()


class Decoder:
    """Decodes one code; `add` its pictures by number (white 0, black 1, ...), then ask `result`."""

    def __init__(self, code: Code, limits: DecodeLimits | None = None) -> None:
        self.code = code
        self._limits = limits
        self._levels: list[Samples] = []
        self._axes: dict[str, AxisDecoder] = {}
        self._notes: list[str] = []

    def add(self, number: int, image: Samples, variance: Map | None = None) -> None:
        """Fold in picture `number` of `code.planes`, (H, W) uint8, uint16 or float32.

        `variance` (H, W) comes with pictures merged from several exposures; NaN in them is a sample
        that is lost. Without it, a noise law is read off the pictures.
        """
        if min(number, 2) != len(self._levels):
            raise InputError(
                f"picture {number}: got it too early or twice, expected white, black, code"
            )
        if self._levels and image.shape != self._levels[0].shape:
            raise ShapeError(
                f"picture {number}", image.shape, f"{self._levels[0].shape} like white"
            )
        if number >= 2:
            plane = self.code.planes[number]
            self._axes[plane.axis].add(plane, image, variance)
            return
        self._levels.append(image)
        if len(self._levels) == 2:
            self._start(*self._levels)

    def result(self) -> Decoded:
        """The map, from all that was added; pictures that never came are done without."""
        if not self._axes:
            raise NotEnoughData("decode: got no code pictures, expected some after white and black")
        x, y = (self._axes[name].result() for name in AXES)
        white, black = self._levels
        span = np.subtract(white, black, dtype=np.float32)
        if self._clipped > CLIPPED_SHARE:
            # a saturated white says too little; what the code itself saw as brightest says more
            span = np.maximum(span, np.fmax(x.direct, y.direct))
        found = _joined(self.code, span, x, y, self._known)
        if self._known.neighbours:
            found = drop_lonely(found)
        direct = np.where(found.valid, np.clip((x.direct + y.direct) / 2, 0, span), 0)
        both: dict[str, AxisResult] = {"x": x, "y": y}
        waves = {n: r.waves for n, r in both.items() if r.waves is not None}
        if len(waves) == len(AXES):
            blur_px2 = np.array([waves[axis].distortion.blur_px2 for axis in AXES])
            period_px = np.array([waves[axis].period_px for axis in AXES])
            seen = np.clip((x.direct + y.direct) / 2, 0, span).astype(np.float32)
            found = undo_blur(found, seen, blur_px2, period_px, self.code.size)
        return Decoded(
            found,
            direct.astype(np.float32),
            span - direct,
            waves,
            x.lost + y.lost,
            (*self._notes, *(f"nothing could be read from {p}" for p in x.lost + y.lost)),
        )

    def _start(self, white: Samples, black: Samples) -> None:
        self._known = self._limits or default_limits(white, black)
        lit = np.subtract(white, black, dtype=np.float32) > self._known.white_black
        clipped = dropped_samples(white, self._known)[lit]
        self._clipped = float(clipped.mean()) if clipped.size else 0.0
        if self._clipped > CLIPPED_SHARE:
            self._notes.append(f"white is saturated in {self._clipped:.0%} of the lit pixels")
        for axis in AXES:
            self._axes[axis] = AxisDecoder(self.code.axis(axis), axis, white, black, self._known)


def decode(
    code: Code, frames: Iterable[Samples], limits: DecodeLimits | None = None
) -> CorrespondenceMap:
    """Projector coordinates from the photographs of `generate(code)`, in its order."""
    decoder = Decoder(code, limits)
    for number, frame in enumerate(frames):
        decoder.add(number, frame)
    return decoder.result().map


def _joined(
    code: Code, span: Map, x: AxisResult, y: AxisResult, limits: DecodeLimits
) -> CorrespondenceMap:
    """Both coordinates where both are known, the pixel is lit directly, and the panel has them."""
    xy = np.stack([x.x, y.x], axis=-1)
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(xy).all(axis=-1) & (span > limits.white_black)
        valid &= (x.direct + y.direct) / 2 >= limits.lit_share * span
        valid &= ((xy >= -0.5) & (xy <= np.array(code.size) - 0.5)).all(axis=-1)
    sigma = np.stack([x.sigma, y.sigma], axis=-1)
    return CorrespondenceMap(
        np.where(valid[..., None], xy, np.nan).astype(np.float32),
        np.where(valid[..., None], sigma, np.nan).astype(np.float32),
        valid,
    )
