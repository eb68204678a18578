"""The section on the check from another seat: the calibration held against that of a camera elsewhere."""

from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from shlex import quote

from procam.estimate.comparison.compare import Comparison, Difference, LightStep
from procam.estimate.comparison.verdict import AGREE
from procam.files.seats import ELSEWHERE
from procam.interfaces.report.blocks import Block, Table, Text, calibrating, not_there
from procam.interfaces.report.cover import date_text
from procam.interfaces.report.data import Material, written_at
from procam.interfaces.report.words import number, percent
from procam.model.acceptance import HALF_WIDTH
from procam.model.photometry import PRIMARIES
from procam.workflows.other_seat import SeatCheck

LIGHT = {"feedback": "Feedback m", "albedo": "Albedo"}
UNKNOWN = "\N{EN DASH}"
CHANGES = ("moved", "changed", "light")  # verdicts that time explains as well as an error
SERVED = "Directions behind a media server are given and not measured, so the check covers the light alone."


def other_seat(material: Material) -> Iterator[Block]:
    """How far a calibration from another seat differs; how to make one, if there is none."""
    check, used = material.other_seat, material.used
    if used is None:
        yield not_there("A check from another seat", calibrating(material))
    elif check is None:
        yield Text(_missing(material, used), missing=True)
    else:
        yield Text(_seats(check, used))
        yield Text(outcome(check), good=check.agrees)
        found = check.comparison
        if found and check.has_directions:
            yield _directions(check, found)
        if found and found.light:
            yield _light(check, found, used.name)


def _missing(material: Material, used: Path) -> str:
    """That there is no check, and how to make one."""
    assert material.calibration is not None
    folder = quote(str(material.directory))
    far = number(ELSEWHERE * material.calibration.screen.shape.radius_m, 2)
    return (
        f"Calibration {used.name} has not been checked from another seat. To check it, put the camera more "
        f"than {far} m away from where it stood, measure the pixels of its marks and masks in venue.toml "
        f"anew, and run {calibrating(material)}; `procam venue use {folder}@{int(used.name)}` then "
        f"uses this calibration again, and `procam report {folder}` shows the check."
    )


def _seats(check: SeatCheck, used: Path) -> str:
    """Which calibrations are compared, by which cameras, and how far apart these stood."""
    seat, dates = check.seat, [written_at(path) for path in (used, check.seat.directory)]
    camera = (
        f"camera {seat.camera}" if seat.camera != seat.here else f"the same camera, {seat.here}"
    )
    days = abs(dates[1] - dates[0]).days
    apart = f" {days} {'days lie' if days > 1 else 'day lies'} between them." if days else ""
    damaged = f" Damaged, and left out: {', '.join(check.unread)}." if check.unread else ""
    return (
        f"Calibration {used.name} of {date_text(dates[0])} is compared with {seat.directory.name} of "
        f"{date_text(dates[1])}.{apart} That one is by {camera}, which stood {number(seat.distance_m, 2)} m "
        f"away ({percent(seat.share, 2)} of the dome's radius) and was turned by "
        f"{number(round(seat.turn_deg, 1), 2)} degrees. No photograph was used for both.{damaged}"
    )


def outcome(check: SeatCheck) -> str:
    """The outcome in a sentence, and what else may explain a difference."""
    found = check.comparison
    if found is None:
        return f"The two cannot be compared: {check.refusal}"
    if not check.has_directions:
        light, _, _ = found.verdict.text.partition(". Directions: ")
        return f"{_agreement('') if check.agrees else _differ(light)} {SERVED}"
    if check.agrees:
        return _agreement(found.verdict.text if found.verdict.kind == "turned" else "")
    if found.verdict.sound:
        times = f"{number(check.in_sigmas or 0.0, 2)} times their standard error"
        return _differ(
            f"directions relative to each other by {times}; a camera's lens may be wrong"
        )
    since = " What changed between the captures shows here too; if something did, check again."
    return _differ(found.verdict.text) + (since if found.verdict.kind in CHANGES else "")


def _agreement(how: str) -> str:
    return f"The two agree within their error bars{how and ', up to ' + how}."


def _differ(how: str) -> str:
    return f"The two differ: {how}."


def _directions(check: SeatCheck, found: Comparison) -> Table:
    """Differences of directions and areas, of each projector and of all together."""
    rows = {f"Projector {name}": row for name, row in found.projectors.items()}
    turn = number(sum(v * v for v in found.turn_arcmin) ** 0.5, 2)
    stated = ""
    if check.in_sigmas is not None:
        stated = (
            f" That is {number(check.in_sigmas, 2)} times the standard error that the two state; above "
            f"{AGREE:g} something is wrong."
        )
    return Table(
        ["Directions [arcmin]", "Difference", "95 % within", "Largest", "With rotation", "Area"],
        [[title, *_cells(row)] for title, row in {**rows, "All": found.together}.items()],
        f"Difference: root mean square over {number(found.together.pixels)} pixels, less a rotation of "
        f"{turn} arcmin that all have in common and that the survey of the marks decides.{stated} Area: "
        "difference of the solid angles that a projector lights.",
    )


def _cells(row: Difference) -> list[str]:
    angles = (row.turned.rms, row.turned.p95, row.turned.max, row.as_is.rms)
    return [*map(number, angles), percent(row.areas.sum, 2)]


def _light(check: SeatCheck, found: Comparison, here: str) -> Table:
    """Figures of the light from both seats, with their differences."""
    return Table(
        [
            "Light",
            here,
            check.seat.directory.name,
            "Difference",
            "95 % interval",
            "In standard errors",
        ],
        [
            [f"{LIGHT[name]}, {colour}", *_steps(step, i)]
            for name, step in found.light.items()
            for i, colour in enumerate(PRIMARIES)
        ],
        "Both calibrations take from venue.toml the survey of the marks, the floor, and what is known of the "
        "cameras (lens, vignetting, glare). Errors of these show only as far as they act differently from "
        "the two seats.",
    )


def _steps(step: LightStep, i: int) -> list[str]:
    a, b, half = step.first[i], step.second[i], HALF_WIDTH * step.sigma[i]
    share, low, high = (
        percent((b - a + side * half) / a, 2) if a else UNKNOWN for side in (0, -1, 1)
    )
    sigmas = number(step.sigmas[i], 2) if isfinite(step.sigmas[i]) else UNKNOWN
    return [number(a, 4), number(b, 4), share, f"{low} to {high}", sigmas]
