"""`procam report`: a venue's report as one HTML file, its operators' sheet, and pictures to judge by eye."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output, as_dicts
from procam.workflows.capture.newest import venue_of

if TYPE_CHECKING:
    from procam.model.acceptance import Finding
    from procam.workflows.other_seat import SeatCheck

EXAMPLE = "procam report my-dome"


def report(
    where: Annotated[Path, typer.Argument(metavar="VENUE|SESSION", help="What to report on.")],
    sheet: Annotated[
        bool,
        typer.Option(
            "--sheet", help="Write operator-sheet.html instead: one page for who runs the dome."
        ),
    ] = False,
    stills: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write test pictures to judge the dome by eye instead, with an index.",
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Write report.html, one self-contained file; exit 1 if a limit of the client is not kept.

    The limits are those of the table acceptance in venue.toml; a figure that has not been measured well
    enough to show that its limit is kept counts as not kept.
    """
    output = Output(json)
    venue = venue_of(where) if (where / "plan.json").is_file() else where
    if not sheet and stills is None:
        _report(venue, output)
        return
    document = {}
    if sheet:
        from procam.interfaces.report.sheet import write_sheet

        document["sheet"] = str(write_sheet(venue))
        output.say(f"{document['sheet']} written")
    if stills is not None:
        document["stills"] = _stills(venue, stills, output)
    output.finish(document)


def _report(venue: Path, output: Output) -> None:
    from procam.interfaces.plots.figure import require_matplotlib
    from procam.interfaces.report.acceptance import found
    from procam.interfaces.report.data import read_material
    from procam.interfaces.report.page import write_page

    require_matplotlib()
    material = read_material(venue)
    path = write_page(material, venue / "report.html")
    judged = found(material)
    _say_verdicts(judged, output)
    output.say(f"{path} written")
    acceptance = {finding.name: finding.as_dict() for finding in judged}
    document = {"report": str(path), "acceptance": acceptance}
    output.finish(document | {"other_seat": _other_seat(material.other_seat)})
    if any(finding.verdict != "pass" for finding in judged):
        raise typer.Exit(1)


def _other_seat(check: "SeatCheck | None") -> dict[str, Any] | None:
    """The check from another seat for machines; None if there is none."""
    if check is None:
        return None
    from procam.interfaces.report.other_seat import outcome

    seat = check.seat
    return {
        "calibration": str(seat.directory),
        "camera": seat.camera,
        "distance_m": seat.distance_m,
        "agrees": check.agrees if check.comparison else None,
        "verdict": outcome(check),
        "figures": as_dicts(check.figures()),
    }


def _say_verdicts(judged: "Sequence[Finding]", output: Output) -> None:
    """A line for each limit of the client, and one for all."""
    from procam.interfaces.report.acceptance import limit_text, value_texts, verdict

    for finding in judged:
        values = ", ".join(value_texts(finding))
        output.say(f"  {finding.verdict:9}  {finding.name}: {values}; {limit_text(finding)}")
    if outcome := verdict(judged):
        output.say(outcome.text)


def _stills(venue: Path, folder: Path, output: Output) -> str:
    from procam.files.calibration import load_calibration
    from procam.files.versions import chosen_calibration
    from procam.workflows.stills import write_stills

    output.follow(write_stills(load_calibration(chosen_calibration(venue)), folder))
    index = str(folder / "index.txt")
    output.say(f"{index} written; it names what to look for in each picture beside it")
    return index
