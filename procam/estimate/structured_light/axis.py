"""One axis of a code: the result that every decoder gives, and the decoder of sinusoids."""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import AnyArray, Map
from procam.errors import NotEnoughData
from procam.estimate.structured_light.cells import CellImages
from procam.estimate.structured_light.codes import Axis, AxisCode, Plane
from procam.estimate.structured_light.limits import (
    BEYOND_SHARE,
    WAVES_BEYOND_MOST,
    WAVES_BEYOND_SHARE,
    DecodeLimits,
    beyond_panel,
    dropped_samples,
)
from procam.estimate.structured_light.scatter_bias import remove_scatter_bias
from procam.estimate.structured_light.self_calibration import UNKNOWNS, SinusoidImages
from procam.estimate.structured_light.shift_checks import edges_refusal, phases_note
from procam.estimate.structured_light.sinusoids import (
    MIN_SAMPLES,
    SinusoidResult,
    complete_base_set,
    decode_sinusoids,
)

NO_SURPLUS = 1e-9  # standard error of the flux surplus once it has been measured and removed
FEW_FRINGES = (
    16  # with more of them, each pattern has half of white's flux (docs/theory/scatter-bias.md)
)


@dataclass(frozen=True, slots=True)
class AxisResult:
    """One coordinate.

    Attributes
    ----------
    x, sigma : (H, W) column or row [px] and its standard error; NaN where not known.
    direct : (H, W) direct light at full white [image unit].
    waves : the fit of the sinusoidal patterns, if the axis has them.
    lost : patterns whose photographs could not be used.
    note : what was out of the ordinary. refused : why the coordinate should not be used. Empty if nothing.
    """

    x: Map
    sigma: Map
    direct: Map
    waves: SinusoidResult | None
    lost: tuple[Plane, ...]
    note: str = ""
    refused: str = ""


class SinusoidDecoder:
    """Collects the photographs of one axis with sinusoids and decodes them; some may be missing.

    Stripes beneath the sinusoids count the cells in which a phase lies.
    """

    def __init__(
        self, coding: AxisCode, axis: Axis, white: AnyArray, black: AnyArray, limits: DecodeLimits
    ) -> None:
        assert coding.waves is not None
        self._set, self._length, self._limits = coding.waves, coding.length, limits
        self._white, self._black = white, black
        self._order = coding.sines(axis)
        self._awaited = len(coding.planes(axis))
        self._stripes = None if coding.codewords is None else CellImages(coding, white, black)
        self._frames: dict[int, AnyArray] = {}
        self._variances: Map | None = None  # sum over the frames
        self._waves: SinusoidResult | None = None
        self._note = self._refused = ""
        self._lost: list[Plane] = []

    def add(self, plane: Plane, image: AnyArray, variance: Map | None = None) -> None:
        """Add one photograph; the last one starts the decoding and frees the photographs."""
        self._awaited -= 1
        if plane.kind == "binary":
            assert self._stripes is not None
            self._stripes.add(plane, image)
        else:
            self._add_sine(plane, image, variance)
        if not self._awaited:
            self._solve()

    def _add_sine(self, plane: Plane, image: AnyArray, variance: Map | None) -> None:
        if variance is not None:
            before = np.float32(0) if self._variances is None else self._variances
            self._variances = np.asarray(variance + before, np.float32)
        self._frames[self._order.index(plane)] = image

    def result(self) -> AxisResult:
        """The coordinate, from the photographs so far."""
        if self._frames:
            self._solve()
        waves = self._waves
        if waves is None:  # too few photographs
            nothing = np.full(self._white.shape, np.nan, np.float32)
            return AxisResult(nothing, nothing, np.zeros_like(nothing), None, tuple(self._lost))
        x = waves.x
        if self._set.single and self._stripes is None:  # the position within a period alone
            x = np.mod(x, np.float32(self._order[0].period))
        note, refused = self._note, self._refused
        if self._stripes is None:
            refused = beyond_panel(waves.unplaced, self._length, WAVES_BEYOND_MOST)
            note = beyond_panel(waves.unplaced, self._length, WAVES_BEYOND_SHARE) or note
        return AxisResult(
            x,
            waves.sigma,
            2 * waves.amplitude,
            waves,
            tuple(self._lost),
            "" if refused else note,
            refused,
        )

    def _solve(self) -> None:
        completed = complete_base_set(self._frames, self._set, self._white, self._black)
        shown = sorted(completed)
        frames = [completed[i] for i in shown]
        restored = len(completed) - len(self._frames)
        self._frames = {}
        waves = self._set.kept(np.isin(np.arange(len(self._order)), shown))
        cells = None if self._stripes is None else self._stripes.result()
        if len(frames) < MIN_SAMPLES if cells is None else waves.base < UNKNOWNS:
            self._lost += [self._order[i] for i in shown]
            return
        span = np.subtract(self._white, self._black, dtype=np.float32)
        pictures = SinusoidImages(
            frames,
            waves,
            self._length,
            span,
            span > self._limits.white_black,
            [dropped_samples(frame, self._limits) for frame in frames],
            None if self._variances is None else self._variances / np.float32(len(frames)),
            cells=cells,
            restored=restored,
        )
        few = cells is None and self._set.single
        if few and self._length < FEW_FRINGES * self._set.periods[0]:
            self._waves = self._solve_few_fringes(replace(pictures, surplus_sigma=NO_SURPLUS))
        else:
            self._waves = decode_sinusoids(pictures)
        whole = np.where(np.logical_or.reduce(pictures.dropped), np.nan, self._waves.x)
        self._note = phases_note(frames, waves, whole, self._length)
        if cells is not None:
            period, found = float(waves.periods[0]), self._waves
            self._refused = edges_refusal(cells, found.x, period) or beyond_panel(
                found.unplaced, self._length, BEYOND_SHARE
            )

    def _solve_few_fringes(self, pictures: SinusoidImages) -> SinusoidResult:
        """Decode few wide fringes: scattered light biases them and their own fit cannot show it."""
        found = decode_sinusoids(pictures)
        if len(pictures.frames) < len(self._order):
            return found  # the steps are no longer equal
        levels, shifts = (self._white, self._black), pictures.waves.shifts
        try:
            frames = remove_scatter_bias(
                np.stack(pictures.frames), *levels, found.amplitude, shifts
            )
        except NotEnoughData:
            return found  # the whole screen is lit, so the bias cannot be measured
        return decode_sinusoids(replace(pictures, frames=list(frames)))
