"""`procam ingest`: photographs of a rig that procam does not drive."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._run_log import RunLog
from procam.workflows.capture import ingest as ingesting
from procam.workflows.capture.newest import venue_of

EXAMPLE = "procam ingest my-dome/sessions/hand-0001 --camera zenith --photos DCIM"
SHOWN = 8  # missing shots that a line names


def ingest(
    session: Annotated[Path, typer.Argument(help="Session made by `procam patterns VENUE`.")],
    camera: Annotated[str, typer.Option(help="Camera's name in venue.toml.")],
    photos: Annotated[
        Path | None, typer.Option(help="Folder of linear 16-bit TIFF, PNG or JPEG.")
    ] = None,
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
    undo: Annotated[
        bool,
        typer.Option("--undo", help="Set all photographs of the camera aside, to begin again."),
    ] = False,
    json: Json = False,
) -> None:
    """Assign photographs taken by hand or by another program to the shots of a session.

    Each photograph is identified by the number in it. What is missing or left out is listed; run the
    command again with more photographs, and it adds only what is missing.
    """
    stored, venue = Session(session), load_venue(venue_of(session))
    output = Output(json, RunLog(venue.directory, "ingest"))
    stored.read_plan()  # refuses what is no session before a lock file is made in it
    if (photos is None) != undo:
        raise InputError(
            "--photos: give a folder of photographs, or --undo to set aside those stored"
        )
    if photos is None and (index or by_order or replace):
        raise InputError("--undo: goes alone; leave --index, --by-order and --replace out")
    if photos is None:
        aside = ingesting.undo(venue, stored, camera)
        output.say(
            f"photographs by camera {camera} are in {aside} now; ingest others with --photos"
        )
        output.finish({"set_aside": str(aside)})
        return
    events = ingesting.ingest(
        venue, stored, camera, photos, index, by_order=by_order, replace_stored=replace
    )
    result = output.follow(events)
    for note in result["notes"]:
        output.say(note)
    missing = result["missing"]
    more = f" and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
    output.say(f"{result['stored']} photographs stored for camera {camera}")
    if missing:
        output.say(
            f"missing: {', '.join(missing[:SHOWN])}{more}; photograph them and ingest again: "
            "it adds only what is missing"
        )
    else:
        output.say(f"nothing is missing; now run: procam solve {session}")
    output.finish(result)
