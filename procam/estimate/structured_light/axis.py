"""One axis of a code in the making: its stripes, its waves, and what both say together."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.errors import NotEnoughData
from procam.estimate.structured_light.codes import Axis, AxisCode, Plane
from procam.estimate.structured_light.limits import DecodeLimits, dropped_samples
from procam.estimate.structured_light.scatter_bias import balanced
from procam.estimate.structured_light.self_calibration import SinusoidImages
from procam.estimate.structured_light.sinusoids import (
    MIN_SAMPLES,
    SinusoidResult,
    complete_base_set,
    decode_sinusoids,
)
from procam.estimate.structured_light.stripes import StripeFolder

Samples = NDArray[Any]
Map = NDArray[np.float32]
NO_SURPLUS = 1e-9
FEW_FRINGES = 16  # more of them have next to no flux of their own (science.md s.2)


@dataclass(frozen=True, slots=True)
class AxisResult:
    """One coordinate.

    Attributes
    ----------
    x, sigma : (H, W) column or row [px] and its standard error; NaN where not known.
    direct : (H, W) light that came straight, at full white [image unit].
    waves : the fit of the sinusoidal pictures. lost : pictures that could not be used.
    """

    x: Map
    sigma: Map
    direct: Map
    waves: SinusoidResult | None
    lost: tuple[Plane, ...]


class AxisDecoder:
    """Folds the pictures of one axis in; pictures may be missing."""

    def __init__(
        self, coding: AxisCode, axis: Axis, white: Samples, black: Samples, limits: DecodeLimits
    ) -> None:
        self._coding, self._limits = coding, limits
        self._white, self._black = white, black
        self._order = [p for p in coding.planes(axis) if p.kind == "sine"]
        self._frames: dict[int, Samples] = {}
        self._variances: Map | None = None  # sum over the frames
        self._waves: SinusoidResult | None = None
        scattering = limits.lit_share > 0
        self._stripes = (
            StripeFolder(white, black, limits.contrast, scattering) if coding.bits else None
        )
        self._waiting: tuple[Plane, Samples] | None = None
        self._lost: list[Plane] = []

    def add(self, plane: Plane, image: Samples, variance: Map | None = None) -> None:
        """Fold in one picture; a pattern and its inverse follow each other."""
        if plane.kind == "sine":
            if variance is not None:
                before = np.float32(0) if self._variances is None else self._variances
                self._variances = np.asarray(variance + before, np.float32)
            self._frames[self._order.index(plane)] = image
            if len(self._frames) == len(self._order):
                self._solve_waves()
            return
        if self._waiting is not None and self._waiting[0].bit == plane.bit:
            (first, other), self._waiting = self._waiting, None
            self._fold(plane, *((image, other) if first.inverse else (other, image)))
            return
        self._flush()
        self._waiting = plane, image
        if not self._coding.inverses:
            self._flush()

    def result(self) -> AxisResult:
        """The coordinate, from what is there."""
        self._flush()
        if self._frames:
            self._solve_waves()
        if self._stripes is None:
            return self._of_waves()
        column, spread = self._stripes.columns(self._coding)
        if self._coding.waves is None:
            return self._of_stripes(self._stripes, column, spread)
        return self._of_both(column, self._of_waves())

    def _of_stripes(self, stripes: StripeFolder, column: Map, spread: Map) -> AxisResult:
        ok = stripes.certain() & np.isfinite(column)
        return AxisResult(
            np.where(ok, column, np.nan).astype(np.float32),
            np.where(ok, spread, np.nan).astype(np.float32),
            stripes.most().astype(np.float32),
            None,
            tuple(self._lost),
        )

    def _of_waves(self) -> AxisResult:
        waves = self._waves
        if waves is None:  # too few pictures were left
            nothing = np.full(self._white.shape, np.nan, np.float32)
            return AxisResult(nothing, nothing, np.zeros_like(nothing), None, tuple(self._lost))
        x = waves.x
        if self._stripes is None and self._coding.waves is not None and self._coding.waves.single:
            x = np.mod(
                x, np.float32(self._order[0].period)
            )  # one fringe: there is nothing to number
        return AxisResult(x, waves.sigma, 2 * waves.amplitude, waves, tuple(self._lost))

    def _of_both(self, column: Map, found: AxisResult) -> AxisResult:
        """Stripes number the fringes of waves, or must agree with them."""
        x, ok = self._coding.numbered(found.x, column)
        sigma = np.where(ok, found.sigma, np.nan).astype(np.float32)
        return AxisResult(x.astype(np.float32), sigma, found.direct, found.waves, found.lost)

    def _flush(self) -> None:
        """A picture without its partner: pattern and inverse add up to white and black."""
        if self._waiting is None:
            return
        (plane, image), self._waiting = self._waiting, None
        both = (
            (self._complement(image), image) if plane.inverse else (image, self._complement(image))
        )
        self._fold(plane, *both)

    def _fold(self, plane: Plane, pattern: Samples, inverse: Samples) -> None:
        assert self._stripes is not None
        if not self._stripes.add(pattern, inverse, plane.bit):
            self._lost.append(plane)

    def _complement(self, image: Samples) -> Samples:
        other = self._white.astype(np.float32) + self._black - image
        if image.dtype.kind == "f":
            return other
        return np.clip(other, 0, np.iinfo(image.dtype).max).astype(image.dtype)

    def _solve_waves(self) -> None:
        assert self._coding.waves is not None
        completed = complete_base_set(
            self._frames, self._coding.waves.base, self._white, self._black
        )
        shown = sorted(completed)
        frames = [completed[i] for i in shown]
        self._frames = {}
        if len(frames) < MIN_SAMPLES:
            self._lost += [self._order[i] for i in shown]
            return
        waves = self._coding.waves.kept(np.isin(np.arange(len(self._order)), shown))
        span = np.subtract(self._white, self._black, dtype=np.float32)
        pictures = SinusoidImages(
            frames,
            waves,
            self._coding.length,
            span,
            span > self._limits.white_black,
            [dropped_samples(frame, self._limits) for frame in frames],
            None if self._variances is None else self._variances / np.float32(len(frames)),
        )
        if waves.single and self._coding.length < FEW_FRINGES * waves.periods[0]:
            self._waves = self._of_few_fringes(replace(pictures, surplus_sigma=NO_SURPLUS))
        else:
            self._waves = decode_sinusoids(pictures)

    def _of_few_fringes(self, pictures: SinusoidImages) -> SinusoidResult:
        """Few wide fringes are biased by scattered light, and cannot tell by how much themselves."""
        found = decode_sinusoids(pictures)
        if len(pictures.frames) < len(self._order):
            return found  # equal steps no more
        levels, shifts = (self._white, self._black), pictures.waves.shifts
        try:
            frames = balanced(np.stack(pictures.frames), *levels, found.amplitude, shifts)
        except NotEnoughData:
            return found  # the whole screen is lit: nowhere to measure it
        return decode_sinusoids(replace(pictures, frames=list(frames)))
