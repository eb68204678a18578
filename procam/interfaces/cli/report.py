"""`procam report`: a venue's report as one HTML file, its operators' sheet, and pictures to judge by eye."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from procam.files.calibration import load_calibration
from procam.files.versions import calibration_in_use, list_calibrations
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output, as_dicts
from procam.interfaces.plots.figure import require_matplotlib
from procam.interfaces.report.acceptance import found, limit_text, value_texts, verdict
from procam.interfaces.report.data import read_material
from procam.interfaces.report.other_seat import outcome
from procam.interfaces.report.page import write_page
from procam.interfaces.report.sheet import write_sheet
from procam.model.acceptance import Finding
from procam.workflows.other_seat import SeatCheck
from procam.workflows.stills import write_stills

EXAMPLE = "procam report my-dome"


def report(
    venue: VenueArgument,
    stills: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write test pictures to judge the screen by eye too, with an index.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Write report.html and operator-sheet.html; exit 1 if a limit of the client is not kept.

    Each is one self-contained file; the sheet is a page for who runs the venue. The limits are those of the
    table acceptance in venue.toml; a figure that has not been measured well enough to show that its limit is
    kept counts as not kept.
    """
    output = Output(json)
    if stills is not None:
        calibration_in_use(venue)  # refuses before anything is written
    document, kept = _report(venue, output)
    if list_calibrations(venue):
        document["sheet"] = str(write_sheet(venue))
        output.say(f"{document['sheet']} written")
    if stills is not None:
        document["stills"] = _stills(venue, stills, output)
    output.finish(document)
    if not kept:
        raise typer.Exit(1)


def _report(venue: Path, output: Output) -> tuple[dict[str, Any], bool]:
    """Write the report; what it says for machines, and whether all limits are kept."""
    require_matplotlib()
    material = read_material(venue)
    path = write_page(material, venue / "report.html")
    judged = found(material)
    _say_verdicts(judged, output)
    output.say(f"{path} written")
    acceptance = {finding.name: finding.as_dict() for finding in judged}
    document: dict[str, Any] = {"report": str(path), "acceptance": acceptance}
    kept = all(finding.verdict == "pass" for finding in judged)
    return document | {"other_seat": _other_seat(material.other_seat)}, kept


def _other_seat(check: SeatCheck | None) -> dict[str, Any] | None:
    """The check from another seat for machines; None if there is none."""
    if check is None:
        return None
    seat = check.seat
    return {
        "calibration": str(seat.directory),
        "camera": seat.camera,
        "distance_m": seat.distance_m,
        "agrees": check.agrees if check.comparison else None,
        "verdict": outcome(check),
        "figures": as_dicts(check.figures()),
    }


def _say_verdicts(judged: Sequence[Finding], output: Output) -> None:
    """A line for each limit of the client, and one for all."""
    for finding in judged:
        values = ", ".join(value_texts(finding))
        output.say(f"  {finding.verdict:9}  {finding.name}: {values}; {limit_text(finding)}")
    if total := verdict(judged):
        output.say(total.text)


def _stills(venue: Path, folder: Path, output: Output) -> str:
    output.follow(write_stills(load_calibration(calibration_in_use(venue)), folder))
    index = str(folder / "index.txt")
    output.say(f"{index} written; it names what to look for in each picture beside it")
    return index
