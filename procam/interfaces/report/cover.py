"""The first page of a report: what was calibrated, with what and how; and where everything comes from."""

import platform
from collections.abc import Iterator, Mapping
from dataclasses import fields
from datetime import datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from procam.files.venue.load import Venue
from procam.files.venue.server_checks import DOME_MASTER
from procam.files.venue.tables import CameraTable, ProjectorTable
from procam.interfaces.report.data import Material
from procam.interfaces.report.words import percent
from procam.maths.geometry.sphere import cap_solid_angle
from procam.model.calibration import Calibration
from procam.model.photometry import PRIMARIES
from procam.model.screen import Dome

WHITE_SHARES = (0.1, 0.25, 0.5, 0.75)
ORIGINS = {"input_sha256": "Fingerprint of the captures (SHA-256)", "versions": "Software"}
PHOTOGRAPHED = (
    "Cameras photographed coded patterns of each projector, from which the direction of every projector "
    "pixel was solved, seen from the middle of the {word}."
)
SERVED = (
    "The media server's picture was taken as aligned, so the directions of its pixels are known; cameras "
    "photographed what it shows."
)
LIGHT = (
    "From photographs of white, black and single colours came the light of each projector, and how much of "
    "it the {word} scatters back onto itself."
)
REMOVED = (
    "procam computes pictures whose direct light is less by the light that will be scattered, so that both "
    "together are what the content asks for."
)
SIZES = {
    "box": "width, depth and height in m",
    "cylinder": "radius in m, arc in degrees, height in m",
    "mesh": "its extent in m",
}


def method(material: Material) -> str:
    """The method in three sentences."""
    served = material.venue is not None and is_served(material.venue)
    text = " ".join([SERVED if served else PHOTOGRAPHED, LIGHT, REMOVED])
    return text.format(word=material.word)


def is_served(venue: Venue) -> bool:
    """Whether a media server feeds the dome, from dome masters."""
    return all(table.kind == DOME_MASTER for table in venue.table.projectors.values())


def date_text(moment: datetime) -> str:
    """A date and time for people."""
    return f"{moment.day} {moment:%B %Y, %H:%M}"


def facts(material: Material) -> Iterator[tuple[str, str]]:
    """What was calibrated, with what and when, as (name, text)."""
    yield "Venue", material.name
    if material.used and material.calibrated_at:
        yield "Calibration", f"{material.used.name} of {date_text(material.calibrated_at)}"
    if material.calibration:
        yield "Screen", _screen(material.calibration)
    if material.venue:
        for name, camera in material.venue.table.cameras.items():
            yield f"Camera {name}", _device(camera)
        for name, projector in material.venue.table.projectors.items():
            yield f"Projector {name}", _device(projector)
    if material.calibration:
        if material.is_dome:
            yield "Checked from another seat", _checked(material)
        yield "Calibrated with", _versions(material.calibration.provenance.versions)
    yield "Report written with", f"procam {version('procam')}, Python {platform.python_version()}"


def _checked(material: Material) -> str:
    check = material.other_seat
    if check is None:
        return "not yet"
    agreement = "it agrees" if check.agrees else "it does not agree"
    result = "it cannot be compared" if check.refusal else agreement
    return f"by calibration {check.seat.directory.name}: {result}"


def _screen(calibration: Calibration) -> str:
    screen = calibration.screen
    if isinstance(screen, Dome):
        half_angle = f"{np.degrees(screen.half_angle):.0f}"
        return f"dome, radius {screen.radius_m:g} m, pole to rim {half_angle} degrees"
    lengths = " x ".join(f"{length:g}" for length in screen.size)
    return f"{screen.kind} of {lengths} ({SIZES[screen.kind]}), lit: {', '.join(screen.lit)}"


def _device(table: CameraTable | ProjectorTable) -> str:
    """Size and backend, and what is known of the kind."""
    kind = ""
    if isinstance(table, ProjectorTable) and table.kind == DOME_MASTER:
        kind = "media server, "
    width, height = table.size
    return f"{kind}{width} x {height} px, backend {table.backend}"


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {number}" for name, number in versions.items()) or "not recorded"


def provenance(material: Material) -> Iterator[tuple[str, str]]:
    """The origin of the report, as (name, text)."""
    calibration = material.calibration
    yield "Venue folder", str(material.directory)
    if calibration is None:
        return
    names = ", ".join(p.name for p in material.calibrations)
    yield "Calibrations", f"{names} ({material.used.name} is shown)" if material.used else names
    yield "Screen", _screen(calibration)
    for name, camera in calibration.cameras.items():
        yield f"Camera {name}", f"{camera.size[0]} x {camera.size[1]} px, {camera.sensor.bits} bits"
    for name, projector in calibration.projectors.items():
        yield f"Projector {name}", f"{projector.model.size[0]} x {projector.model.size[1]} px"
    for each in fields(calibration.provenance):
        text = _origin_text(getattr(calibration.provenance, each.name))
        if each.name != "by_hand" and text:  # that has a section of its own
            yield ORIGINS.get(each.name, each.name.replace("_", " ").capitalize()), text


def _origin_text(value: Any) -> str:
    """An entry of the provenance in one line."""
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {v}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value))
    return str(value)


def contrast(calibration: Calibration | None) -> dict[str, Any] | None:
    """The values of the formula in the section on limits, for this dome."""
    if calibration is None or not isinstance(calibration.screen, Dome):
        return None
    albedo = float(calibration.albedo.value.mean())
    share = cap_solid_angle(calibration.screen.half_angle) / (4 * np.pi)
    rows = [
        (percent(p), f"{(1 - albedo * share * (1 - p)) / (albedo * share * p):.0f} : 1")
        for p in WHITE_SHARES
    ]
    return {"albedo": f"{albedo:.2f}", "share": f"{share:.2f}", "rows": rows, "colours": PRIMARIES}
