"""`procam session capture`: one capture session of a venue."""

from shlex import quote
from typing import Annotated

import typer

from procam.files.venue.load import load_venue
from procam.interfaces.cli._dry_run import run_dry
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._run_log import RunLog
from procam.workflows.capture.newest import capture_newest

EXAMPLE = "procam session capture my-dome --dry-run"


def capture(
    venue: VenueArgument,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only print how many shots, minutes and GB.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the patterns and photograph them; a run that was stopped is resumed.

    A lost cable, a full disk or a killed process loses no photograph: run the command again.
    """
    loaded = load_venue(venue)
    if dry_run:
        run_dry(loaded, Output(json))
        return
    output = Output(json, RunLog(venue, "capture"))
    session = output.follow(capture_newest(loaded)).directory
    output.say(f"captured; now run: procam session solve {quote(str(session))}")
    output.finish({"session": str(session)})
