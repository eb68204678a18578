"""Comparison of two calibrations of the same rig from independent captures.

Standard errors describe the scatter between captures, not errors of the model: a wrong lens bends
the directions of every capture, and no residual of one of them shows it. A second capture with
another camera, or with the same camera rotated about its axis, bends them differently. (Errors that
are symmetric about the camera's axis do not show when it is rotated about that axis.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array
from procam.errors import CalibrationError
from procam.estimate.comparison.common_pixels import (
    CommonPixels,
    common_pixels,
    error_over_sigma,
    rms_arcmin,
    smooth_field,
)
from procam.estimate.comparison.verdict import (
    CLOSE,
    PictureStep,
    Verdict,
    exchanged,
    find_exchanged,
    judge_difference,
    judge_light,
    judge_responses,
)
from procam.maths.geometry.pose import rotation_vector
from procam.maths.geometry.sphere import ARCMIN
from procam.model.calibration import Calibration
from procam.model.photometry import Departure, ResponseCurve, departures
from procam.model.transport import Measured

SHAPE = ("radius_m", "degree")
DRIVES = np.linspace(0, 1, 86)  # every third code


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles between the directions of two calibrations [arcmin].

    `error_over_sigma` is their rms over the combined standard error. It is 1 if the standard errors
    are right, with a scatter of a third where errors of a pose dominate. It is less where A and B
    share errors, such as those of fiducials surveyed once, and after the common rotation, which
    removes the effect of such errors.
    """

    rms: float
    median: float
    p95: float
    max: float
    error_over_sigma: float

    @classmethod
    def between(cls, pairs: Sequence[CommonPixels], turn: Array) -> "Angles":
        """Over all pixels of some projectors, with B rotated by `turn` (3, 3)."""
        steps = [pair.step(turn) for pair in pairs]
        chord = np.concatenate([np.linalg.norm(step, axis=1) for step in steps])
        angle = 2 * ARCMIN * np.arcsin(np.minimum(chord / 2, 1))
        variance = np.concatenate([pair.variance for pair in pairs])
        median, p95 = np.percentile(angle, (50, 95))
        return cls(
            float(np.sqrt(np.mean(angle**2))),
            float(median),
            float(p95),
            float(angle.max()),
            error_over_sigma(chord[:, None], variance),
        )


@dataclass(frozen=True, slots=True)
class Areas:
    """Solid angles of B over those of A, minus 1 [-]: median and rms over pixels, and of their sums.

    `alone` : share of the pixels valid in A or B that are valid in one only.
    """

    median: float
    rms: float
    sum: float
    alone: float

    @classmethod
    def between(cls, pairs: Sequence[CommonPixels]) -> "Areas":
        """Over all pixels of some projectors."""
        first = np.concatenate([pair.first_sr for pair in pairs]).astype(float)
        second = np.concatenate([pair.second_sr for pair in pairs]).astype(float)
        step = second / first - 1
        return cls(
            float(np.median(step)),
            float(np.sqrt(np.mean(step**2))),
            float(second.sum() / first.sum() - 1),
            float(np.mean([pair.alone for pair in pairs])),
        )


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference of one projector, or of all.

    Attributes
    ----------
    pixels : number of pixels that are valid in both.
    as_is, turned : angles before and after the common rotation.
    smooth_arcmin : rms, after the rotation, of one smooth field over the dome (an error of a lens or
        of the dome's shape) [arcmin].
    rest_arcmin : rms of the remainder (noise, or projectors that moved) [arcmin].
    areas : solid angles.
    """

    pixels: int
    as_is: Angles
    turned: Angles
    smooth_arcmin: float
    rest_arcmin: float
    areas: Areas


@dataclass(frozen=True, slots=True)
class LightStep:
    """A figure of the light per channel (3,) in A and B, and the `sigma` (3,) of their difference."""

    first: list[float]
    second: list[float]
    sigma: list[float]

    @property
    def sigmas(self) -> list[float]:
        """B - A over its standard error; infinite where they differ and sigma is 0."""
        step, sigma = np.subtract(self.second, self.first), np.array(self.sigma)
        safe = np.where(sigma > 0, sigma, 1.0)
        return [float(s) for s in np.where(sigma > 0, step / safe, np.where(step, np.inf, 0.0))]


@dataclass(frozen=True, slots=True)
class Comparison:
    """The differences of two calibrations.

    `turn_arcmin` (3,): the common rotation of the rig from B to A as a rotation vector in A's frame.
    `screen`: "radius_m" and "degree" of the harmonics, of A and of B.
    `light`: "feedback" (m) and "albedo", where both calibrations have them. `responses`: of the projectors.
    `picture`: None where it was not asked for, or no place is lit by both.
    """

    projectors: Mapping[str, Difference]
    together: Difference
    turn_arcmin: list[float]
    screen: Mapping[str, tuple[float, float]]
    light: Mapping[str, LightStep]
    responses: Mapping[str, Departure]
    verdict: Verdict
    picture: PictureStep | None = None


def compare_calibrations(first: Calibration, second: Calibration) -> Comparison:
    """Compare A and B, whose projectors have the same names and sizes.

    Raises
    ------
    NotEnoughData
        If the calibrations share too few pixels of a projector.
    CalibrationError
        If their screens are of other kinds.
    """
    if first.screen.kind != second.screen.kind:
        raise CalibrationError(
            f"the screens of these calibrations are a {first.screen.kind} and a {second.screen.kind}, which "
            "cannot be compared"
        )
    pairs = {
        name: common_pixels(name, here, second.projectors[name], first.screen.shape.radius_m)
        for name, here in first.projectors.items()
    }
    thin = {name: pair.thinned() for name, pair in pairs.items()}
    cameras = list(dict.fromkeys([*first.cameras, *second.cameras]))
    verdict, turn = judge_difference(thin, cameras)
    together = [*pairs.values()]
    if Angles.between([*thin.values()], np.eye(3)).rms > CLOSE * ARCMIN:
        partners = find_exchanged(first, second)
        verdict = exchanged(partners) if partners else verdict
    bent, light = _smooth(thin, turn), _light(first, second)
    responses = response_departures(first, second)
    verdict = judge_light(verdict, {name: step.sigmas for name, step in light.items()})
    return Comparison(
        {name: _difference([pair], turn, [bent[name]]) for name, pair in pairs.items()},
        _difference(together, turn, [*bent.values()]),
        [float(v) for v in ARCMIN * rotation_vector(turn)],
        {n: (getattr(first.screen.shape, n), getattr(second.screen.shape, n)) for n in SHAPE},
        light,
        responses,
        judge_responses(verdict, responses),
    )


def _smooth(thin: Mapping[str, CommonPixels], turn: Array) -> dict[str, tuple[Array, Array]]:
    """Per projector the smooth field common to all and the remainder of its differences, (N, 3) each."""
    steps = {name: pair.step(turn) for name, pair in thin.items()}
    variance = np.concatenate([pair.variance for pair in thin.values()])
    direction = np.concatenate([pair.first for pair in thin.values()])
    field = smooth_field(direction, np.concatenate([*steps.values()]), variance)
    ends = np.cumsum([len(step) for step in steps.values()])[:-1]
    parts = dict(zip(thin, np.split(field, ends), strict=True))
    return {name: (parts[name], step - parts[name]) for name, step in steps.items()}


def _difference(
    pairs: Sequence[CommonPixels], turn: Array, bent: Sequence[tuple[Array, Array]]
) -> Difference:
    smooth, rest = zip(*bent, strict=True)
    return Difference(
        sum(len(pair.variance) for pair in pairs),
        Angles.between(pairs, np.eye(3)),
        Angles.between(pairs, turn),
        rms_arcmin(*smooth),
        rms_arcmin(*rest),
        Areas.between(pairs),
    )


def _light(first: Calibration, second: Calibration) -> dict[str, LightStep]:
    steps = {
        "feedback": _light_step(first.feedback, second.feedback),
        "albedo": _light_step(first.albedo, second.albedo),
    }
    return {n: s for n, s in steps.items() if np.isfinite([s.first, s.second, s.sigma]).all()}


def _light_step(first: Measured, second: Measured) -> LightStep:
    sigma = np.hypot(first.sigma, second.sigma)
    return LightStep(first.value.tolist(), second.value.tolist(), sigma.tolist())


def response_departures(first: Calibration, second: Calibration) -> dict[str, Departure]:
    """The clearest difference of each projector of A and B."""
    return {
        name: _step(here.photometry.response, second.projectors[name].photometry.response)
        for name, here in first.projectors.items()
    }


def _step(first: ResponseCurve, second: ResponseCurve) -> Departure:
    (old, old_sigma), (new, new_sigma) = _at(first), _at(second)
    step, sigma = new - old, np.hypot(old_sigma, new_sigma)
    whole, *each = departures(step, sigma, DRIVES)
    return whole if whole.excess > 1 else max([whole, *each], key=lambda found: found.excess)


def _at(curve: ResponseCurve) -> tuple[Array, Array]:
    """Light (n, 3) of a response, and its standard error, at `DRIVES`."""
    light, sigma = (
        np.stack([np.interp(DRIVES, curve.levels, column) for column in table.T], axis=1)
        for table in (curve.values, curve.sigma)
    )
    return light, sigma
