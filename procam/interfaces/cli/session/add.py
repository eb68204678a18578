"""`procam session add`: photographs of a rig that procam does not drive."""

from dataclasses import asdict
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import CameraOption, Json, SessionArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.workflows.capture import ingest as ingesting
from procam.workflows.capture.newest import venue_of

EXAMPLE = "procam session add my-dome --camera zenith --photos DCIM"
SHOWN = 8  # missing shots that a line names


def add(
    session: SessionArgument,
    camera: CameraOption,
    photos: Annotated[Path, typer.Option(help="Folder of linear 16-bit TIFF, PNG or JPEG.")],
    index: Annotated[
        Path | None,
        typer.Option(help="CSV with lines file,shot; it overrides the shot marks in the pictures."),
    ] = None,
    by_order: Annotated[
        bool,
        typer.Option(
            "--by-order", help="Take photographs without a readable number by their order."
        ),
    ] = False,
    *,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace photographs that are stored already.")
    ] = False,
    json: Json = False,
) -> None:
    """Assign photographs taken by hand or by another program to the shots of a session.

    Each photograph is identified by the number in it. What is missing or left out is listed; run the
    command again with more photographs, and it adds only what is missing.
    """
    stored, venue = Session(session), load_venue(venue_of(session))
    output = Output(json, RunLog(venue.directory, "add"))
    stored.read_plan()  # refuses what is no session before a lock file is made in it
    events = ingesting.ingest(
        venue, stored, camera, photos, index, by_order=by_order, replace_stored=replace
    )
    result = output.follow(events)
    for note in result.notes:
        output.say(note)
    missing = result.missing
    more = f" and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
    output.say(f"{result.stored} photographs stored for camera {camera}")
    if missing:
        output.say(
            f"missing: {', '.join(missing[:SHOWN])}{more}; photograph them and add them too: "
            "it adds only what is missing"
        )
    else:
        output.say(f"nothing is missing; now run: procam session solve {quote(str(session))}")
    output.finish(asdict(result))
