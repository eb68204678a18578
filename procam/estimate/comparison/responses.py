"""Responses of projectors in two calibrations: where they differ, by more than their standard errors."""

import numpy as np

from procam.arrays import Array
from procam.model.calibration import Calibration
from procam.model.photometry import Departure, ResponseCurve

DRIVES = np.linspace(0, 1, 86)  # every third code


def response_departures(first: Calibration, second: Calibration) -> dict[str, Departure]:
    """The clearest difference of each projector of A and B."""
    return {
        name: _step(here.photometry.response, second.projectors[name].photometry.response)
        for name, here in first.projectors.items()
    }


def _step(first: ResponseCurve, second: ResponseCurve) -> Departure:
    (old, old_sigma), (new, new_sigma) = _at(first), _at(second)
    step, sigma = new - old, np.hypot(old_sigma, new_sigma)
    mean_sigma = np.sqrt((sigma**2).sum(axis=1)) / sigma.shape[1]
    whole = _clearest(step.mean(axis=1), mean_sigma, None)
    each = [_clearest(step[:, c], sigma[:, c], c) for c in range(step.shape[1])]
    return whole if whole.excess > 1 else max([whole, *each], key=lambda found: found.excess)


def _clearest(sizes: Array, errors: Array, channel: int | None) -> Departure:
    found = (
        Departure(float(s), float(e), float(drive), channel)
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
