"""`procam session plan`: the pictures of a capture session, to show and photograph by hand."""

from pathlib import Path
from shlex import join
from typing import Annotated

import typer

from procam.files.images.movie_file import video_library
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import check_new_folder
from procam.workflows.capture.by_hand import hold_s, write_by_hand
from procam.workflows.capture.session_plan import server_of

EXAMPLE = "procam session plan my-dome pictures --movie"
ONE_BY_ONE = "show one projector's pictures after the other's, all other shutters closed"


def plan(
    directory: VenueArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="New folder for the pictures.")],
    movie: Annotated[bool, typer.Option("--movie", help="Also one movie per projector.")] = False,
    json: Json = False,
) -> None:
    """Write the pictures of a capture session, to show and photograph by hand.

    Every picture carries a shot mark, by which `procam session add` sorts the photographs.
    """
    output, venue = Output(json), load_venue(directory)
    check_new_folder(out)
    if movie:
        video_library()  # refuses before anything is written
    session = write_by_hand(venue, out, movie)
    shots = session.read_plan().shots
    minutes = sum(hold_s(shot) for shot in shots) / 60
    server = server_of(venue)
    then = f"open them and feed {server.name} with its pictures" if server else ONE_BY_ONE
    output.say(
        f"{len(shots)} shots written to {out}, {minutes:.0f} min; order.csv lists what to show and how "
        "long to expose it"
    )
    output.say(
        f"first close all shutters and photograph the dark; then {then}; do not change focus, zoom, "
        "aperture or ISO"
    )
    for camera in venue.cameras:
        add = ["procam", "session", "add", str(session.directory), "--camera", camera]
        output.say(f"then run: {join(add)} --photos PHOTOS")
    output.finish({"session": str(session.directory), "out": str(out), "shots": len(shots)})
