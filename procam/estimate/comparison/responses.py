"""Responses of projectors in two calibrations: where they differ, by more than their standard errors."""

from dataclasses import dataclass

import numpy as np

from procam.arrays import Array
from procam.model.calibration import Calibration
from procam.model.photometry import ResponseCurve

MOST_RESPONSE = 0.02  # of white, at any drive
CERTAIN = 5.0  # sigmas
CHANNELS = ("red", "green", "blue")
DRIVES = np.linspace(0, 1, 86)  # every third code


@dataclass(frozen=True, slots=True)
class ResponseStep:
    """The clearest difference of a response, B - A.

    Attributes
    ----------
    size, sigma : light over white, and its standard error. drive : where, 0..1.
    channel : index of the primary; None for the mean of all.
    """

    size: float
    sigma: float
    drive: float
    channel: int | None

    @property
    def excess(self) -> float:
        """Size over what it must exceed to count: 0.02 of white, or five standard errors."""
        return abs(self.size) / max(MOST_RESPONSE, CERTAIN * self.sigma)

    @property
    def text(self) -> str:
        """In words."""
        what = "its" if self.channel is None else f"its {CHANNELS[self.channel]}"
        return (
            f"{what} response by {self.size:+.3f} of white at drive {255 * self.drive:.0f} of 255"
        )


def response_steps(first: Calibration, second: Calibration) -> dict[str, ResponseStep]:
    """The clearest difference of each projector of A and B."""
    return {
        name: _step(here.photometry.response, second.projectors[name].photometry.response)
        for name, here in first.projectors.items()
    }


def _step(first: ResponseCurve, second: ResponseCurve) -> ResponseStep:
    (old, old_sigma), (new, new_sigma) = _at(first), _at(second)
    step, sigma = new - old, np.hypot(old_sigma, new_sigma)
    mean_sigma = np.sqrt((sigma**2).sum(axis=1)) / sigma.shape[1]
    whole = _clearest(step.mean(axis=1), mean_sigma, None)
    each = [_clearest(step[:, c], sigma[:, c], c) for c in range(step.shape[1])]
    return whole if whole.excess > 1 else max([whole, *each], key=lambda found: found.excess)


def _clearest(sizes: Array, errors: Array, channel: int | None) -> ResponseStep:
    found = (
        ResponseStep(float(s), float(e), float(drive), channel)
        for s, e, drive in zip(sizes, errors, DRIVES, strict=True)
    )
    return max(found, key=lambda each: each.excess)


def _at(curve: ResponseCurve) -> tuple[Array, Array]:
    """Light (n, 3) of a response, and its standard error, at `DRIVES`."""
    light, sigma = (
        np.stack([np.interp(DRIVES, curve.levels, column) for column in table.T], axis=1)
        for table in (curve.values, curve.sigma)
    )
    return light, sigma
