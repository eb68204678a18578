"""Verifies a venue: photographs it, compares with the calibrated session, and names what has changed."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array
from procam.estimate.drift.changes import VenueChange, find_changes
from procam.estimate.drift.finding import Finding
from procam.estimate.drift.findings import name_causes
from procam.files.venue.load import Venue
from procam.model.calibration import Calibration
from procam.model.quality import Figure
from procam.workflows.events import Event, Steps
from procam.workflows.photographs.driven import Photographer
from procam.workflows.photographs.open import check_devices
from procam.workflows.solve.plausible import OFF_REFUSED, uneven_picture
from procam.workflows.verify.photographs import read_reference, take_photographs

SETTLE_S = 1.5  # for irises and lamps that follow the picture


@dataclass(frozen=True, slots=True)
class Verified:
    """Outcome of a verification: what has changed, the causes, and the number of photographs."""

    change: VenueChange
    findings: list[Finding]
    photographs: int

    @property
    def alarm(self) -> bool:
        """Whether the dome shows any of it."""
        return any(finding.alarm for finding in self.findings)

    def summary(self) -> str:
        """One line, such as "south moved, dust"."""
        names = [f"{each.subject} {each.cause}".strip() for each in self.findings]
        return ", ".join(dict.fromkeys(names)) or "nothing has changed"

    def figures(self) -> dict[str, Figure]:
        """What was measured, changed or not, by name."""
        change, figures = self.change, dict[str, Figure]()
        for name, each in change.projectors.items():
            figures[f"shows.{name}"] = Figure(each.shows, "-")
            if each.motion is None:
                continue
            figures |= {
                f"moved.{name}": Figure(each.moved_px, "px", sigma=each.moved_sigma),
                f"blur.{name}": Figure(each.blur_px2, "px2", sigma=each.blur_sigma),
                f"light.{name}": _relative(each.light, each.light_sigma),
                f"black.{name}": Figure(each.black, "-", sigma=each.black_sigma),
            }
            if each.response:
                exponent = each.response.exponent, each.response.exponent_sigma
                figures[f"exponent.{name}"] = Figure(exponent[0], "-", sigma=exponent[1])
        if change.scatter:
            value, sigma = change.scatter.value.tolist(), change.scatter.sigma.tolist()
            figures["scattered_light"] = Figure(value, "-", sigma=sigma)
        value, sigma = change.ambient.value.tolist(), change.ambient.sigma.tolist()
        figures["ambient"] = Figure(value, "rel", sigma=sigma)
        turned = change.camera.turned_deg, change.camera.turned_sigma
        return {**figures, "camera_turned": Figure(turned[0], "deg", sigma=turned[1])}


def _relative(log: Array, sigma: Array) -> Figure:
    """Light of three channels over that before, of its logarithm."""
    return Figure(np.exp(log).tolist(), "-", sigma=(np.exp(log) * sigma).tolist())


def _own_picture(calibration: Calibration) -> Iterator[Finding]:
    """A calibration that contradicts itself, as an earlier version of procam may have written it."""
    share, text = uneven_picture(calibration)
    if share > OFF_REFUSED:  # a solve notes less, and it is used
        nan = float("nan")
        yield Finding("calibration", "", nan, nan, "-", text, "calibrate again: procam calibrate")


def verify(
    photographer: Photographer,
    venue: Venue,
    calibration: Calibration,
    names: Collection[str] = (),
) -> Steps[Verified]:
    """Photograph and compare, of the projectors `names` alone, or of all.

    Raises
    ------
    InputError
        The calibration is of other devices than the venue.
    FileFormatError
        The photographs of the calibrated session are gone.
    """
    check_devices(venue, calibration)
    reference = read_reference(venue, calibration).of(names or list(calibration.projectors))
    total, done, now = 4 + 4 * len(reference.pictures), 0, None
    for done, (text, now) in enumerate(take_photographs(photographer, reference), start=1):
        if now is None:
            yield Event("verify", done, total, f"{text} photographed")
    assert now is not None
    levels = {name: pictures["levels"] for name, pictures in reference.pictures.items()}
    change = find_changes(calibration, reference.photographs, now, levels)
    findings = [*_own_picture(calibration), *name_causes(calibration, change)]
    verified = Verified(change, findings, done - 1)
    yield Event("verify", total, total, verified.summary())
    return verified
