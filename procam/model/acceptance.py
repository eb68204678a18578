"""Acceptance of a calibration: figures against the limits of a client's contract, not procam's own goals."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from procam.arrays import Array
from procam.model.calibration import Calibration

Side = Literal["most", "least", "within"]
Verdict = Literal["pass", "fail", "not shown"]
HALF_WIDTH = 1.96  # of a 95 % interval, in standard errors


@dataclass(frozen=True, slots=True)
class Criterion:
    """A figure of a calibration that a contract can limit.

    Attributes
    ----------
    label : the figure in plain words. unit : of the limit, "-" for ratios and shares.
    side : whether a limit is the most or the least that is accepted, or how far from 0 on both sides.
    measured : whether the figure is stated with a standard error. The others are statistics of all pixels
        or cells, or standard errors themselves, and have none.
    last : whether only the last number of a list counts.
    """

    label: str
    unit: str = "-"
    side: Side = "most"
    measured: bool = False
    last: bool = False


CRITERIA: Mapping[str, Criterion] = {
    "direction_sigma_relative_arcmin": Criterion(
        "Error of directions relative to each other (sharpness of seams), one standard error",
        "arcmin",
    ),
    "direction_sigma_arcmin": Criterion(
        "Error of directions in the building (position of the picture), one standard error",
        "arcmin",
    ),
    "server_misalignment_rms_arcmin": Criterion("Misalignment of the media server", "arcmin"),
    "geometry_residual_rms_px": Criterion(
        "Residual of the geometry, in pixels of the projectors", "px"
    ),
    "sphere_variance_ratio": Criterion("Departure of the screen from its stated shape (1: none)"),
    "coverage": Criterion("Share of the screen that is lit", side="least"),
    "additivity_error": Criterion("Departure of white from the sum of its primaries"),
    "feedback": Criterion("Scattered light per light projected", measured=True),
    "albedo": Criterion("Albedo of the screen", measured=True),
    "loop_residual_own": Criterion("Difference between photograph and prediction", "rel"),
    "loop_own_jnd": Criterion(
        "Visible difference between photograph and prediction, 95 % of the dome", "JND"
    ),
    "loop_unseen_residual": Criterion(
        "Difference between photograph and prediction, of a picture that the loop did not learn from",
        "rel",
        last=True,
    ),
    "other_seat_direction_relative_rms_arcmin": Criterion(
        "Difference from another seat: directions relative to each other", "arcmin"
    ),
    "other_seat_direction_relative_over_sigma": Criterion(
        "Difference from another seat: directions relative to each other, in standard errors"
    ),
    "other_seat_direction_rms_arcmin": Criterion(
        "Difference from another seat: directions in the building", "arcmin"
    ),
    "other_seat_solid_angle_sum": Criterion(
        "Difference from another seat: area that a projector lights", side="within"
    ),
    "other_seat_feedback": Criterion(
        "Difference from another seat: scattered light per light projected",
        side="within",
        measured=True,
    ),
    "other_seat_albedo": Criterion(
        "Difference from another seat: albedo", side="within", measured=True
    ),
}


@dataclass(frozen=True, slots=True)
class Finding:
    """A figure against its limit.

    `value` and `sigma` are one number, or three for the channels; both are None where nothing was
    measured, `sigma` also where none is known.
    """

    name: str
    limit: float
    value: Array | None
    sigma: Array | None

    @property
    def criterion(self) -> Criterion:
        """What is limited."""
        return CRITERIA[self.name]

    @property
    def verdict(self) -> Verdict:
        """The verdict; "not shown" without a value, or without a standard error that is stated."""
        if self.value is None:
            return "not shown"
        unknown = np.nan if self.criterion.measured else 0.0
        sigma = np.full(self.value.shape, unknown) if self.sigma is None else self.sigma
        return judge(self.value, sigma, self.limit, self.criterion.side)

    def interval(self) -> tuple[Array, Array] | None:
        """The 95 % interval, (low, high); None where no standard error is known."""
        if self.value is None or self.sigma is None:
            return None
        return self.value - HALF_WIDTH * self.sigma, self.value + HALF_WIDTH * self.sigma

    def as_dict(self) -> dict[str, Any]:
        """The finding for JSON; NaN is null."""
        low, high = self.interval() or (None, None)
        return {
            "label": self.criterion.label,
            "value": _plain(self.value),
            "low": _plain(low),
            "high": _plain(high),
            "limit": self.limit,
            "side": self.criterion.side,
            "unit": self.criterion.unit,
            "verdict": self.verdict,
        }


def judge(value: Array, sigma: Array, limit: float, side: Side) -> Verdict:
    """The verdict on values (K,) with standard errors (K,), which all have to keep a limit.

    "fail" if a value is beyond the limit, "pass" if the whole 95 % interval of each is within it, "not
    shown" if an interval reaches beyond or a value is not finite. The limit itself is within.

    >>> judge(np.array([0.8]), np.array([0.2]), 1.0, "most")
    'not shown'
    """
    known = np.where(np.isfinite(value), value, np.nan)
    known = np.abs(known) if side == "within" else known
    beyond = (limit - known) if side == "least" else (known - limit)
    if (beyond > 0).any():
        return "fail"
    return "pass" if (beyond + HALF_WIDTH * sigma <= 0).all() else "not shown"


def findings(calibration: Calibration | None, limits: Mapping[str, float]) -> Iterator[Finding]:
    """Each figure that has a limit, in the order of `CRITERIA`; nothing is measured without a calibration."""
    for name in CRITERIA:
        if name in limits:
            yield Finding(name, limits[name], *_measured(calibration, name))


def _measured(calibration: Calibration | None, name: str) -> tuple[Array | None, Array | None]:
    """Value and standard error of a figure."""
    if calibration is None:
        return None, None
    if name in ("feedback", "albedo"):
        found = getattr(calibration, name)
        return found.value, found.sigma
    figure = calibration.quality.get(name)
    if figure is None:
        return None, None
    parts = slice(-1, None) if CRITERIA[name].last else slice(None)
    value, sigma = np.atleast_1d(figure.value)[parts], figure.sigma
    return value, None if sigma is None else np.atleast_1d(sigma)[parts]


def _plain(values: Array | None) -> float | list[float | None] | None:
    """Numbers for JSON: one alone, several as a list."""
    if values is None:
        return None
    numbers = [float(v) if np.isfinite(v) else None for v in values]
    return numbers if len(numbers) > 1 else numbers[0]
