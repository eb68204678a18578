"""`procam report`: a venue's report as one HTML file."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.report import write_report
from procam.workflows.capture.newest import venue_of

EXAMPLE = "procam report my-dome"


def report(
    where: Annotated[Path, typer.Argument(metavar="VENUE|SESSION", help="What to report on.")],
    json: Json = False,
) -> None:
    """Write report.html, one self-contained file."""
    output = Output(json)
    path = write_report(venue_of(where) if (where / "plan.json").is_file() else where)
    output.say(f"{path} written")
    output.finish({"report": str(path)})
