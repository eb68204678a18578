"""Photographs of a structured-light code to projector coordinates, decoded as they arrive.

White and black come first: they give the limits and the lit pixels. Each axis is decoded as soon as
its last photograph is in, so memory does not grow with the number of axes. Both coordinates are then
joined, outliers dropped, and for sinusoids the bias that defocus causes at borders is corrected. What
a pixel's area adds to the standard error comes last.
"""

from dataclasses import dataclass, field

import numpy as np

from procam.arrays import AnyArray, Map
from procam.errors import InputError, NotEnoughData, ShapeError
from procam.estimate.structured_light.axis import AxisResult, SinusoidDecoder
from procam.estimate.structured_light.codes import AXES, NAMES, Code
from procam.estimate.structured_light.defocus_bias import correct_defocus_bias
from procam.estimate.structured_light.limits import DecodeLimits, default_limits, dropped_samples
from procam.estimate.structured_light.outliers import (
    drop_beyond_panel,
    drop_outliers,
    with_area_error,
)
from procam.estimate.structured_light.sinusoids import SinusoidResult
from procam.estimate.structured_light.stripes import StripeDecoder
from procam.model.correspondence import CorrespondenceMap

CLIPPED_SHARE = 0.01  # of the lit pixels: more saturated ones in white are reported


@dataclass(frozen=True)
class Decoded:
    """Result of decoding a code.

    Attributes
    ----------
    map : projector coordinates per camera pixel.
    waves : the fits of the sinusoids, with blur, response and noise, per axis that has them.
    notes : what was out of the ordinary, one line each.
    refused : why the map should not be used, one line each.
    """

    map: CorrespondenceMap
    waves: dict[str, SinusoidResult] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()


class Decoder:
    """Decodes one code: `add` its photographs by index (white 0, black 1, ...), then take `result`."""

    def __init__(self, code: Code, limits: DecodeLimits | None = None) -> None:
        self.code = code
        self._asked = limits
        self._levels: list[AnyArray] = []
        self._axes: dict[str, StripeDecoder | SinusoidDecoder] = {}
        self._notes: list[str] = []

    def add(self, number: int, image: AnyArray, variance: Map | None = None) -> None:
        """Add the photograph (H, W) of `code.planes[number]`, uint8, uint16 or float32.

        `variance` (H, W) comes with photographs merged from several exposures, in which NaN marks an
        unusable sample. Without it, the noise law is estimated from the photographs themselves.

        Raises
        ------
        InputError : white, black and the code do not come in this order.
        ShapeError : the photograph has another shape than white.
        """
        if min(number, 2) != len(self._levels):
            raise InputError(
                f"photograph {number} came too early or twice; add white, then black, then the code"
            )
        if self._levels and image.shape != self._levels[0].shape:
            raise ShapeError(
                f"photograph {number}", image.shape, f"{self._levels[0].shape} like white"
            )
        if number >= 2:
            plane = self.code.planes[number]
            self._axes[plane.axis].add(plane, image, variance)
            return
        self._levels.append(image)
        if len(self._levels) == 2:
            self._start(*self._levels)

    def result(self) -> Decoded:
        """The map, from the photographs so far; those that are missing are done without.

        Raises
        ------
        NotEnoughData : white or black is missing.
        """
        if not self._axes:
            raise NotEnoughData("decode: white and black are missing; add them, then the code")
        x, y = (self._axes[name].result() for name in AXES)
        white, black = self._levels
        span = np.subtract(white, black, dtype=np.float32)
        if self._clipped > CLIPPED_SHARE:
            # a saturated white is too low; the brightest light of the code itself is a better bound
            span = np.maximum(span, np.fmax(x.direct, y.direct))
        found = _joined(self.code, span, x, y, self._limits)
        if self._limits.neighbours:
            found = drop_beyond_panel(drop_outliers(found), span, self.code.size)
        named = list(zip(NAMES.values(), (x, y), strict=True))
        found = self._without_defocus_bias(found, x, y, span)
        return Decoded(
            with_area_error(found, span, self._limits.white_black),
            {n: r.waves for n, r in zip(AXES, (x, y), strict=True) if r.waves is not None},
            (
                *self._notes,
                *(f"nothing could be read from {plane}" for plane in x.lost + y.lost),
                *(f"{name}: {axis.note}" for name, axis in named if axis.note),
            ),
            tuple(f"pictures: {name}: {axis.refused}" for name, axis in named if axis.refused),
        )

    def _start(self, white: AnyArray, black: AnyArray) -> None:
        self._limits = self._asked or default_limits(white, black)
        lit = np.subtract(white, black, dtype=np.float32) > self._limits.white_black
        clipped = dropped_samples(white, self._limits)[lit]
        self._clipped = float(clipped.mean()) if clipped.size else 0.0
        if self._clipped > CLIPPED_SHARE:
            self._notes.append(f"white is saturated in {self._clipped:.0%} of the lit pixels")
        for axis in AXES:
            coding = self.code.axis(axis)
            if coding.waves is not None:
                self._axes[axis] = SinusoidDecoder(coding, axis, white, black, self._limits)
            elif coding.codewords is not None:
                self._axes[axis] = StripeDecoder(coding.codewords, white, black, self._limits)

    def _without_defocus_bias(
        self, found: CorrespondenceMap, x: AxisResult, y: AxisResult, span: Map
    ) -> CorrespondenceMap:
        """The map with the bias corrected, where sinusoids measured the blur of both axes."""
        if x.waves is None or y.waves is None:
            return found
        both = (x.waves, y.waves)
        blur_px2 = np.array([waves.distortion.blur_px2 for waves in both])
        period_px = np.array([waves.period_px for waves in both])
        seen = np.clip((x.direct + y.direct) / 2, 0, span).astype(np.float32)
        return correct_defocus_bias(found, seen, blur_px2, period_px, self.code.size)


def _joined(
    code: Code, span: Map, x: AxisResult, y: AxisResult, limits: DecodeLimits
) -> CorrespondenceMap:
    """Both coordinates where both are known, the pixel has direct light, and they are on the panel."""
    xy = np.stack([x.x, y.x], axis=-1, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(xy).all(axis=-1) & (span > limits.white_black)
        valid &= (x.direct + y.direct) / 2 >= limits.lit_share * span
        valid &= ((xy >= -0.5) & (xy <= np.array(code.size) - 0.5)).all(axis=-1)
    sigma = np.stack([x.sigma, y.sigma], axis=-1, dtype=np.float32)
    xy[~valid], sigma[~valid] = np.nan, np.nan
    return CorrespondenceMap(xy, sigma, valid)
