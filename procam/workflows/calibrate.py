"""From stored captures to a calibration; needs no device and repeats to the last bit."""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from procam.errors import InputError
from procam.estimate.assemble import Measurement, assemble
from procam.estimate.codes import make_code
from procam.estimate.decode import Decoder
from procam.estimate.geometry import (
    GeometrySolution,
    gather,
    solve_geometry,
    sphere_test,
)
from procam.estimate.limits import DecodeLimits
from procam.estimate.photometry import ResponseFit, fit_colour, tile_levels
from procam.estimate.radiance import Radiometer
from procam.estimate.transport import Separation
from procam.estimate.view import DomeView
from procam.files.calibration import next_directory, save_calibration
from procam.files.session import Session
from procam.files.venue import Venue
from procam.model.correspondence import CorrespondenceMap
from procam.workflows.events import Event
from procam.workflows.provenance import provenance
from procam.workflows.readings import Readings

Image = NDArray[np.float32]
NOISE_DN = 6.0  # differences below a few counts mean nothing
DARK_SIGMAS = 3.0
WORKERS = 2  # each holds about 400 MB for a 2.5 Mpx camera
Result = TypeVar("Result")


def solve(venue: Venue, session: Session) -> Iterator[Event]:
    """Decode, solve the geometry, split the light, fit the projectors, write a calibration.

    The last event carries the new directory as `data["calibration"]`.
    """
    readings = _readings(venue, session)
    names = list(venue.table.projectors)
    total = 2 * len(names) + 3
    found: dict[str, CorrespondenceMap] = {}
    sizes = {name: entry.size for name, entry in venue.table.projectors.items()}
    decoded = _each(names, lambda name: _decode(readings, name, sizes[name]))
    for i, (name, found[name]) in enumerate(decoded):
        share = float(found[name].valid.sum() / readings.radiometer.seen.sum())
        yield Event("solve", i + 1, total, f"{name} decoded, {share:.0%} of the camera's circle")
    geometry = _solve_geometry(venue, readings, found)
    ratio, _ = sphere_test(geometry, venue.screen)
    verdict = "the dome is a sphere" if ratio < 2 else "the dome is NOT a sphere"
    yield Event("solve", len(names) + 1, total, f"geometry solved; {verdict} (ratio {ratio:.1f})")
    view = DomeView.of(
        geometry.camera, venue.screen, readings.radiometer.rays, readings.radiometer.seen
    )
    measured: dict[str, Measurement] = {}
    results = _each(names, lambda name: _measure(venue, readings, view, geometry, found, name))
    for i, (name, measured[name]) in enumerate(results):
        yield Event("solve", len(names) + 2 + i, total, f"{name} light split, response fitted")
    calibration = assemble(
        venue.screen,
        geometry,
        view,
        measured,
        provenance(venue, session),
    )
    yield Event("solve", total - 1, total, "maps assembled")
    directory = next_directory(venue.directory)
    save_calibration(calibration, directory)
    yield Event(
        "solve", total, total, f"calibration {directory} written", {"calibration": str(directory)}
    )


def _each(names: list[str], work: Callable[[str], Result]) -> Iterator[tuple[str, Result]]:
    """Results by projector, in order; two at a time, since NumPy leaves the other core idle."""
    with ThreadPoolExecutor(WORKERS) as pool:
        yield from zip(names, pool.map(work, names), strict=True)


def _readings(venue: Venue, session: Session) -> Readings:
    if len(venue.cameras) != 1:
        raise InputError(
            f"{venue.directory / 'venue.toml'}: got {len(venue.cameras)} cameras, but this version "
            "solves with one; keep the one that sees the whole dome"
        )
    camera = next(iter(venue.cameras.values()))
    return Readings(session, session.read_plan(), Radiometer(camera))


def _decode(readings: Readings, name: str, size: tuple[int, int]) -> CorrespondenceMap:
    sensor = readings.radiometer.camera.sensor
    limits = DecodeLimits(
        white_black=DARK_SIGMAS * NOISE_DN, contrast=NOISE_DN, saturated=2.0**sensor.bits - 1
    )
    code_name, pictures = readings.code(name)
    decoder = Decoder(make_code(code_name, size), limits)
    for number, counts in pictures:
        decoder.add(number, counts)
    return decoder.result().map


def _solve_geometry(
    venue: Venue, readings: Readings, found: Mapping[str, CorrespondenceMap]
) -> GeometrySolution:
    return solve_geometry(
        readings.radiometer.camera,
        venue.screen,
        venue.fiducials,
        {name: gather(f) for name, f in found.items()},
        {name: venue.table.projectors[name].size for name in found},
    )


def _measure(
    venue: Venue,
    readings: Readings,
    view: DomeView,
    geometry: GeometrySolution,
    found: Mapping[str, CorrespondenceMap],
    name: str,
) -> Measurement:
    """One projector's light, split and fitted; black is measured at its own long exposure."""
    dark, dark_long = readings.dark()
    black = readings.light(readings.only(name, "black")) - dark_long
    base = black + dark
    white = readings.light(readings.only(name, "white")) - base
    xy = view.projector_pixels(geometry.projectors[name], venue.screen)
    separation = Separation(white, xy, found[name].valid, view.solid_angle_sr)
    for axis, bit, pattern, inverse in readings.stripe_pairs(name):
        separation.add_pair(axis, bit, pattern - base, inverse - base)
    light = separation.result()

    def direct_part(picture: Image) -> Image:
        share = separation.flux_share(picture).astype(np.float32)
        return picture - share * light.scattered

    primaries = [direct_part(readings.light(s) - base) for s in readings.plan.of(name, "primary")]
    colour = fit_colour(primaries, np.where(light.lit[..., None], light.direct, 0))
    fit = ResponseFit(light.direct, colour.mix)
    for shot in readings.plan.of(name, "levels"):
        level = tile_levels(readings.session.pattern(shot), xy, light.lit)
        fit.add(direct_part(readings.light(shot) - base), level)
    return Measurement(light, black, colour, fit.curve())
