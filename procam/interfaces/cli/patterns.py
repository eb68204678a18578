"""`procam patterns`: the pictures of a capture session, or of one code, to show by any means."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.estimate.structured_light.codes import DEFAULT_CODE, picture
from procam.estimate.structured_light.described import folder_order
from procam.files.atomic import replacing_directory
from procam.files.images.movie_file import video_library
from procam.files.images.pixels import write_image
from procam.files.venue.load import load_venue
from procam.interfaces.cli._codes import chosen_code
from procam.interfaces.cli._options import CodeOption, Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import panel_size
from procam.workflows.capture.by_hand import hold_s, write_by_hand
from procam.workflows.capture.session_plan import server_of

EXAMPLE = "procam patterns my-dome --out pictures --movie"
ONE_BY_ONE = "show one projector's pictures after the other's, all other shutters closed"


def patterns(
    out: Annotated[Path, typer.Option(help="New folder for the pictures.")],
    venue: Annotated[
        Path | None,
        typer.Argument(help="Venue folder: all pictures of a capture session, numbered."),
    ] = None,
    size: Annotated[
        str, typer.Option(help="Without a venue: projector size, such as 1280x800.")
    ] = "",
    code: CodeOption = DEFAULT_CODE,
    movie: Annotated[
        bool, typer.Option("--movie", help="With a venue: also one movie per projector.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the pictures of a venue's capture session, or of one code, to show by any means.

    With a venue every picture carries a shot mark, by which `procam ingest` sorts the photographs.
    """
    output = Output(json)
    if venue is None:
        if movie:
            raise InputError("--movie needs a VENUE: a movie shows a venue's capture session")
        if not size:
            raise InputError("patterns: a VENUE or --size is needed")
        _write_code(size, out, code, output)
        return
    if size or code != DEFAULT_CODE:
        raise InputError(
            f"patterns: --size and --code cannot be combined with {venue}; sizes come from its "
            "venue.toml, and the capture session's code is fixed"
        )
    _write_session(venue, out, movie, output)


def _write_code(size: str, out: Path, code: str, output: Output) -> None:
    """The pictures of a code in the order that `procam decode` needs."""
    layout = chosen_code(code, panel_size(size))
    _check_folder(out)
    order = folder_order(layout)
    with replacing_directory(out) as folder:
        for number, plane in enumerate(order):
            write_image(folder / f"{number:04d}.png", picture(layout, layout.planes[plane]))
    output.say(
        f"{len(order)} pictures written to {out}; show them in the order of their names, photograph each, "
        f"and decode with --code {code}"
    )
    output.finish({"out": str(out), "pictures": [str(layout.planes[i]) for i in order]})


def _write_session(directory: Path, out: Path, movie: bool, output: Output) -> None:
    """A session, and the pictures that its rig is to show."""
    venue = load_venue(directory)
    _check_folder(out)
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
    cameras = " or ".join(venue.cameras)
    output.say(f"then run: procam ingest {session.directory} --camera {cameras} --photos PHOTOS")
    output.finish({"session": str(session.directory), "out": str(out), "shots": len(shots)})


def _check_folder(out: Path) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out} is not empty; give a new or empty folder for the pictures")
