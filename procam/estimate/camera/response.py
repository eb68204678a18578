"""The response of a camera's development (sRGB, a gamma, a picture profile) from bracketed photographs.

Photographs are averaged over small squares (`response_blocks`), flat squares of all brightnesses are chosen,
and `response_fit` fits the curve to their levels, per channel where channels differ.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, IndexArray
from procam.errors import CalibrationError, InputError, NotEnoughData
from procam.estimate.camera.response_blocks import (
    BracketBlocks,
    average,
    check_rise,
    check_white,
    choose,
)
from procam.estimate.camera.response_checks import check_response
from procam.estimate.camera.response_fit import CameraResponseFit

MIN_EXPOSURES = 3
MIN_RATIO = 1.2  # of neighbouring exposures; a third of a stop is 1.26
MIN_AGREEING = 4  # photographs that must agree if another is left out
DIFFERENT, DIFFERENT_SIGMAS = 0.02, 4.0  # of channels: share of white, and standard errors
MIN_GAIN = 0.8  # scatter of channels with curves of their own, relative to that with one curve
MOVED_SHARE = 0.002  # of the places, from which those that moved are reported


@dataclass(frozen=True, slots=True)
class CameraResponse:
    """Monotonic inverse response of a camera: levels (K,) to light (K,) or (K, 3), all from 0 to 1.

    Attributes
    ----------
    light : one curve (K,), or one per channel (K, 3) if they differ clearly.
    sigma : standard errors of the light, with those of the shutter times and of the curve's shape.
    exposures_s : (J,) fitted exposures [s] of the photographs used, near the nominal ones.
    residual : rms residual of the levels, as a share of their range [-].
    left_out : the photograph that does not fit the others, if any, and why.
    overruled : the check that refuses the photographs, if it was overruled.
    moved : (rows, columns) squares of the picture that do not fit.
    """

    levels: Array
    light: Array
    sigma: Array
    exposures_s: Array
    residual: float
    left_out: tuple[int, str] | None
    overruled: str
    moved: BoolArray

    @property
    def moved_share(self) -> float:
        """Share of the places that do not fit; 0 if they are too few to count."""
        share = float(self.moved.mean())
        return share if share > MOVED_SHARE else 0.0


def solve_response(
    photos: Iterable[AnyArray], exposures_s: Sequence[float], bits: int, *, accept: bool = False
) -> CameraResponse:
    """Inverse response from photographs (H, W) or (H, W, C) of one still scene, in counts.

    A photograph that contradicts four others or more, which agree, is left out.

    Parameters
    ----------
    photos : three or more, read one at a time.
    exposures_s : shutter time of each [s], accurate to 2 % since headers round them; the fit solves for
        the deviations and includes them in the standard errors.
    bits : depth of the counts, 8..16.
    accept : whether a curve is returned that the checks refuse.

    Raises
    ------
    NotEnoughData
        Too few or too similar exposures, or levels that no photograph has, as white.
    OutOfModelRange
        No curve fits: exchanged photographs, automatic exposure, different picture profiles, or
        a scene that moved.
    DidNotConverge
        The fit did not reach a minimum.
    """
    seconds = _checked_exposures(exposures_s)
    if not 8 <= bits <= 16:
        raise InputError(f"bits: {bits} is no depth of a photograph; give 8 to 16")
    blocks = average(photos, len(seconds), 2.0**bits - 1)
    if not accept:
        check_white(blocks.blocks)
    levels = np.linspace(0, 1, 256 if bits == 8 else 1025)
    return _Solver(blocks, seconds, levels, accept).solve()


@dataclass(frozen=True, slots=True)
class _Solver:
    """The attempts to fit photographs: all, then per channel, then without one of them."""

    blocks: BracketBlocks
    seconds: Array
    levels: Array
    accept: bool

    def solve(self) -> CameraResponse:
        everything = np.arange(len(self.seconds))
        try:
            return self._of(everything, None)
        except CalibrationError as error:
            for number, fits in enumerate(self._without_one()):
                if fits is not None:
                    return self._of(np.delete(everything, number), (number, str(error)))
            if not self.accept:
                raise
            return self._result([self._fit(everything)], everything, None, str(error))

    def _of(self, used: IndexArray, left_out: tuple[int, str] | None) -> CameraResponse:
        try:
            common = self._checked(used)
        except CalibrationError:
            fits = self._channels(used)
            if not fits:
                raise
            return self._result(fits, used, left_out)
        fits = self._channels(used)
        better = fits and max(f.scatter() for f in fits) < MIN_GAIN * common.scatter()
        return self._result(fits if better and self._differ(fits) else [common], used, left_out)

    def _without_one(self) -> list[CameraResponseFit | None]:
        """Fits without each photograph in turn; all None but the best of those that the checks pass."""
        fits: list[CameraResponseFit | None] = [None] * len(self.seconds)
        for number in range(len(self.seconds) if len(self.seconds) > MIN_AGREEING else 0):
            try:
                fits[number] = self._checked(np.delete(np.arange(len(self.seconds)), number))
            except CalibrationError:
                continue
        passed = [fit.residual_rms() for fit in fits if fit]
        return [fit if fit and fit.residual_rms() == min(passed) else None for fit in fits]

    def _channels(self, used: IndexArray) -> list[CameraResponseFit]:
        """Fits of the channels, if they all succeed; else none."""
        if self.blocks.grid[2] != 3:
            return []
        try:
            return [self._checked(used, channel) for channel in range(3)]
        except CalibrationError:
            return []

    def _differ(self, fits: list[CameraResponseFit]) -> bool:
        """Whether the curves of the channels differ clearly."""
        light, sigma = np.array([fit.table(self.levels) for fit in fits]).transpose(1, 0, 2)
        off = np.abs(light - light.mean(axis=0))
        return bool((off > np.maximum(DIFFERENT, DIFFERENT_SIGMAS * sigma)).any())

    def _checked(self, used: IndexArray, channel: int | None = None) -> CameraResponseFit:
        check_rise(self.blocks.of(used, channel), self.seconds[used])
        fit = self._fit(used, channel)
        check_response(fit)
        return fit

    def _fit(self, used: IndexArray, channel: int | None = None) -> CameraResponseFit:
        blocks, seconds = self.blocks.of(used, channel), self.seconds[used]
        moved = self.blocks.moved(used, seconds)
        chosen = choose(
            blocks, moved if channel is None else moved[:, channel :: self.blocks.grid[2]]
        )
        fit = CameraResponseFit(chosen, seconds)
        fit.solve()
        return fit

    def _result(
        self,
        fits: list[CameraResponseFit],
        used: IndexArray,
        left_out: tuple[int, str] | None,
        overruled: str = "",
    ) -> CameraResponse:
        light, sigma = np.array([fit.table(self.levels) for fit in fits]).transpose(1, 2, 0)
        if len(fits) == 1:
            light, sigma = light[:, 0], sigma[:, 0]
        moved = self.blocks.places(self.blocks.moved(used, self.seconds[used]))
        exposures_s = np.mean([fit.exposures_s for fit in fits], axis=0)
        residual = float(np.mean([fit.residual_rms() for fit in fits]))
        return CameraResponse(
            self.levels, light, sigma, exposures_s, residual, left_out, overruled, moved
        )


def _checked_exposures(exposures_s: Sequence[float]) -> Array:
    seconds = np.asarray(exposures_s, float)
    if len(seconds) < MIN_EXPOSURES:
        raise NotEnoughData(
            f"brackets: {len(seconds)} exposures are too few; photograph the same scene at "
            f"{MIN_EXPOSURES} or more, at 1, 2, 4, 8 ... times the shortest"
        )
    if not (np.isfinite(seconds).all() and (seconds > 0).all()):
        raise InputError(f"exposures: {list(exposures_s)} s must be finite and above zero")
    ordered = np.sort(seconds)
    ratio = ordered[1:] / ordered[:-1]
    if ratio.min() < MIN_RATIO:
        k = int(np.argmin(ratio))
        raise NotEnoughData(
            f"brackets: exposures of {ordered[k]:g} and {ordered[k + 1]:g} s are too similar; neighbours "
            f"need a ratio of {MIN_RATIO:g} or more. Leave one out, and step by a factor of 2"
        )
    return seconds
