"""The check of a calibration from another seat: a comparison with one by a camera that stood elsewhere."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import hypot, isfinite
from pathlib import Path

import numpy as np

from procam.errors import CalibrationError, FileFormatError
from procam.estimate.comparison.compare import Comparison, LightStep
from procam.estimate.comparison.verdict import AGREE, LIGHT_SIGMAS
from procam.files.calibration import load_calibration
from procam.files.seats import OtherSeat, other_seats
from procam.model.calibration import Calibration
from procam.model.quality import Figure
from procam.workflows.comparison import compare

SIGMA = "direction_sigma_relative_arcmin"
# behind a media server directions are given, not measured
SERVED = "server_misalignment_rms_arcmin"


@dataclass(frozen=True, slots=True)
class SeatCheck:
    """A calibration held against the newest one from another seat.

    Attributes
    ----------
    comparison : has the one that is checked as A; None where `refusal` says why there is none.
    has_directions : whether directions were measured from both seats, not given by a media server.
    sigma_arcmin : standard error of the differences of directions relative to each other, by what both
        calibrations state; None where one states none.
    unread : names of newer calibrations from another seat that are damaged.
    """

    seat: OtherSeat
    comparison: Comparison | None = None
    has_directions: bool = True
    sigma_arcmin: float | None = None
    refusal: str = ""
    unread: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether the two agree within their error bars, up to a rotation of the whole rig."""
        if self.comparison is None:
            return False
        if not self.has_directions:
            steps = [s for step in self.comparison.light.values() for s in step.sigmas]
            return max(map(abs, steps), default=0.0) <= LIGHT_SIGMAS
        alike = self.in_sigmas is None or self.in_sigmas <= AGREE
        return self.comparison.verdict.sound and alike

    @property
    def in_sigmas(self) -> float | None:
        """Difference of directions relative to each other, in its standard errors; None where not known.

        The verdict of a comparison takes whole error bars, in which the survey of the marks may hide errors
        of a lens; these show here.
        """
        if self.comparison is None or not self.sigma_arcmin or not self.has_directions:
            return None
        return self.comparison.together.turned.rms / self.sigma_arcmin

    def figures(self) -> dict[str, Figure]:
        """The figures that a contract can limit, by name."""
        if self.comparison is None:
            return {}
        found = dict(_light(self.comparison.light))
        if self.has_directions:
            found = _directions(self.comparison) | found
        if self.in_sigmas is not None:
            pixels = self.comparison.together.pixels
            found["other_seat_direction_relative_over_sigma"] = Figure(
                self.in_sigmas, "-", samples=pixels
            )
        return found


def check_from_other_seat(
    venue_dir: Path, used: Path, calibration: Calibration
) -> SeatCheck | None:
    """Compare a calibration of a venue, whose folder is `used`; None if there is none from another seat."""
    unread = list[str]()
    for seat in other_seats(venue_dir, used):
        try:
            other = load_calibration(seat.directory)
        except FileFormatError:  # an older one that is whole may do
            unread.append(seat.directory.name)
            continue
        return replace(_checked(seat, calibration, other), unread=tuple(unread))
    return None


def _checked(seat: OtherSeat, calibration: Calibration, other: Calibration) -> SeatCheck:
    served = any(SERVED in each.quality for each in (calibration, other))
    try:
        found = compare(calibration, other)
    except CalibrationError as error:
        return SeatCheck(seat, refusal=str(error))
    if served and not found.light:
        return SeatCheck(seat, refusal="the light of one of them was not measured")
    return SeatCheck(seat, found, not served, _combined_sigma(calibration, other))


def _combined_sigma(*calibrations: Calibration) -> float | None:
    figures = [each.quality.get(SIGMA) for each in calibrations]
    known = [figure.value for figure in figures if figure and isinstance(figure.value, float)]
    stated = all(isfinite(sigma) and sigma > 0 for sigma in known)
    return hypot(*known) if len(known) == len(calibrations) and stated else None


def _directions(found: Comparison) -> dict[str, Figure]:
    together, pixels = found.together, found.together.pixels
    areas = {name: row.areas.sum for name, row in found.projectors.items()}
    worst = max(areas, key=lambda name: abs(areas[name]))
    relative = Figure(together.turned.rms, "arcmin", samples=pixels)
    return {
        "other_seat_direction_relative_rms_arcmin": relative,
        "other_seat_direction_rms_arcmin": Figure(together.as_is.rms, "arcmin", samples=pixels),
        "other_seat_solid_angle_sum": Figure(
            areas[worst], "-", samples=pixels, note=f"projector {worst}"
        ),
    }


def _light(light: Mapping[str, LightStep]) -> Iterator[tuple[str, Figure]]:
    """Differences of the light as shares of what is checked, with their standard errors."""
    for name, step in light.items():
        first = np.where(np.array(step.first) > 0, step.first, np.nan)  # no light, no share of it
        share, sigma = np.array(step.second) / first - 1, np.array(step.sigma) / first
        yield f"other_seat_{name}", Figure(share.tolist(), "-", sigma=sigma.tolist())
