"""Two calibrations of the same rig from independent captures, held against each other.

Standard errors tell how captures scatter, not whether the model is right: a wrong lens bends the
dome in every capture, and no residual of one of them shows it. A second visit, another camera, or
the same camera turned about its axis bends it otherwise. (Only what is the same all round the
camera's axis stays hidden from a turn about that axis.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.estimate.comparison.common_pixels import (
    CommonPixels,
    common_pixels,
    error_over_sigma,
    smooth_field,
)
from procam.estimate.comparison.verdict import (
    ALIKE,
    ARCMIN,
    Verdict,
    exchanged,
    find_exchanged,
    judge_difference,
    judge_light,
)
from procam.maths.geometry.pose import rotation_vector
from procam.model.calibration import Calibration
from procam.model.transport import Measured

Array = NDArray[np.float64]
SCREEN = ("radius_m", "degree")


@dataclass(frozen=True, slots=True)
class Angles:
    """Angles between the directions that two calibrations tell [arcmin].

    `error_over_sigma`: root of the ratio of their mean square to what both standard errors tell; 1
    if these are honest, with a scatter of a third where errors are those of a pose. Less where A and
    B share errors that both tell of, such as marks surveyed once, and after the turn, which takes
    out what those errors do.
    """

    rms: float
    median: float
    p95: float
    max: float
    error_over_sigma: float

    @classmethod
    def between(cls, pairs: Sequence[CommonPixels], turn: Array) -> "Angles":
        """Of all pixels of some projectors, with B turned by `turn` (3, 3)."""
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
    """Solid angles of B over those of A, minus 1 [-]: the median pixel's, all pixels' rms, the sums'.

    `alone` : share of the pixels valid in either that is valid in one only.
    """

    median: float
    rms: float
    sum: float
    alone: float

    @classmethod
    def between(cls, pairs: Sequence[CommonPixels]) -> "Areas":
        """Of all pixels of some projectors."""
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
    """Everything about one projector, or all.

    Attributes
    ----------
    pixels : how many are valid in both. as_is, turned : angles before and after the common turn.
    smooth_arcmin, rest_arcmin : rms of what is left after the turn, as far as one smooth field over
        the dome explains it (a lens, the shape of the dome), and the rest (noise, or projectors that
        moved) [arcmin].
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
    """A figure of the light per content channel (3,) in A and B; `sigma` (3,) of the difference."""

    first: list[float]
    second: list[float]
    sigma: list[float]

    @property
    def sigmas(self) -> list[float]:
        """B - A in standard errors; infinite where they differ and none is told."""
        step, sigma = np.subtract(self.second, self.first), np.array(self.sigma)
        told = np.where(sigma > 0, sigma, 1.0)
        return [float(s) for s in np.where(sigma > 0, step / told, np.where(step, np.inf, 0.0))]


@dataclass(frozen=True, slots=True)
class Comparison:
    """What two calibrations differ in.

    `turn_arcmin` (3,): the common turn of the rig from B to A as axis times angle, in A's frame.
    `screen`: "radius_m" and "degree" of the bumps, of A and of B.
    `light`: "feedback" (m) and "albedo", where both calibrations have them.
    """

    projectors: Mapping[str, Difference]
    together: Difference
    turn_arcmin: list[float]
    screen: Mapping[str, tuple[float, float]]
    light: Mapping[str, LightStep]
    verdict: Verdict


def compare(first: Calibration, second: Calibration) -> Comparison:
    """A and B, projectors of the same names and sizes, held against each other.

    Raises
    ------
    NotEnoughData : a projector has hardly a pixel that is valid in both.
    """
    pairs = {
        name: common_pixels(name, here, second.projectors[name], first.screen.radius_m)
        for name, here in first.projectors.items()
    }
    thin = {name: pair.thinned() for name, pair in pairs.items()}
    cameras = list(dict.fromkeys([*first.cameras, *second.cameras]))
    verdict, turn = judge_difference(thin, cameras)
    together = [*pairs.values()]
    if Angles.between([*thin.values()], np.eye(3)).rms > ALIKE * ARCMIN:
        partners = find_exchanged(first, second)
        verdict = exchanged(partners) if partners else verdict
    bent, light = _smooth(thin, turn), _light(first, second)
    return Comparison(
        {name: _difference([pair], turn, [bent[name]]) for name, pair in pairs.items()},
        _difference(together, turn, [*bent.values()]),
        [float(v) for v in ARCMIN * rotation_vector(turn)],
        {name: (getattr(first.screen, name), getattr(second.screen, name)) for name in SCREEN},
        light,
        judge_light(verdict, {name: step.sigmas for name, step in light.items()}),
    )


def _smooth(thin: Mapping[str, CommonPixels], turn: Array) -> dict[str, tuple[Array, Array]]:
    """Per projector what one field for all explains of its differences, and the rest, (N, 3) each."""
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
    smooth, rest = (np.concatenate(part) for part in zip(*bent, strict=True))
    return Difference(
        sum(len(pair.variance) for pair in pairs),
        Angles.between(pairs, np.eye(3)),
        Angles.between(pairs, turn),
        _rms_arcmin(smooth),
        _rms_arcmin(rest),
        Areas.between(pairs),
    )


def _rms_arcmin(step: Array) -> float:
    return float(ARCMIN * np.sqrt(np.mean(np.sum(step**2, axis=1))))


def _light(first: Calibration, second: Calibration) -> dict[str, LightStep]:
    steps = {
        "feedback": _light_step(first.feedback, second.feedback),
        "albedo": _light_step(first.albedo, second.albedo),
    }
    return {n: s for n, s in steps.items() if np.isfinite([s.first, s.second, s.sigma]).all()}


def _light_step(first: Measured, second: Measured) -> LightStep:
    sigma = np.hypot(first.sigma, second.sigma)
    return LightStep(first.value.tolist(), second.value.tolist(), sigma.tolist())
