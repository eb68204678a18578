"""From stored captures to a calibration; needs no device and repeats to the last bit."""

from dataclasses import dataclass, replace
from pathlib import Path

from procam.estimate.calibration import assemble
from procam.estimate.light.calibrated_projector import Placed
from procam.files.calibration import save_calibration
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.masks import nudges, protecting
from procam.files.versions import calibration_in_use, list_calibrations, next_directory
from procam.workflows.capture.decoded import with_decoded_bits
from procam.workflows.events import Event, Steps
from procam.workflows.solve.measure_session import measure_session
from procam.workflows.solve.measurements import MeasurementsOnDisk
from procam.workflows.solve.plausible import noted
from procam.workflows.solve.predecessor import compare_with_predecessor
from procam.workflows.solve.provenance import session_provenance


@dataclass(frozen=True, slots=True)
class Solved:
    """A new calibration's folder, and lines on what differs from the one that was in use."""

    directory: Path
    compared: list[str]


def solve(venue: Venue, session: Session) -> Steps[Solved]:
    """Decode, solve the geometry, split the light, fit the projectors, write a calibration.

    Geometry from all cameras; light from the one that sees most. Of a media server only the cameras
    are solved. Warnings are notes of the calibration's provenance.
    """
    with recorded(venue.directory, "session solve"):
        return (yield from _solve(venue, session))


def _solve(venue: Venue, session: Session) -> Steps[Solved]:
    before = list_calibrations(venue.directory)
    used = calibration_in_use(venue.directory) if before else None
    total = len(venue.table.projectors) * (len(venue.cameras) + 1) + 3
    directory = yield from _written(venue, session, total)
    lines = compare_with_predecessor(venue.directory, used, directory)
    yield Event("solve", total, total, f"calibration {directory} written")
    return Solved(directory, lines)


def _written(venue: Venue, session: Session, total: int) -> Steps[Path]:
    """The folder of the new calibration, of which nothing stays in memory."""
    origin = session_provenance(venue, session)  # first of all: it finds what is wrong with masks
    venue = with_decoded_bits(venue, session)
    with MeasurementsOnDisk(venue.directory) as measured:
        seen = yield from measure_session(venue, session, measured, total)
        origin = replace(origin, notes=tuple(seen.notes))
        where = seen.geometry, seen.screen, seen.view, nudges(venue)
        placed = Placed.of(*where, measured.values())
        falloff, map_size = venue.table.blend.falloff_per_rad, venue.table.screen.map_size
        calibration = assemble(placed, measured, origin, falloff, map_size)
    if seen.rig.server:  # content is drawn as the server plays it
        calibration = replace(calibration, canvas=seen.rig.server.canvas)
    quality = seen.rig.figures_with(calibration.quality) | seen.black.figures(calibration)
    calibration = noted(replace(calibration, quality=quality))
    yield Event("solve", total - 1, total, "maps assembled")
    directory = next_directory(venue.directory)
    save_calibration(protecting(venue, calibration), directory)
    return directory
