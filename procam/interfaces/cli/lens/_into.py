"""Where a measured camera goes: into venue.toml."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.venue.edit import Key, require_camera, set_camera_keys
from procam.interfaces.cli._output import Output

IntoOption = Annotated[
    Path | None,
    typer.Option(
        "--into", metavar="VENUE", help="Venue whose venue.toml gets the result; with --camera."
    ),
]
IntoCameraOption = Annotated[
    str, typer.Option("--camera", help="With --into: the camera's name in venue.toml.")
]
VenueIntoOption = Annotated[
    Path, typer.Option("--into", metavar="VENUE", help="Venue whose venue.toml gets the result.")
]


def check_into(into: Path | None, camera: str) -> None:
    """Refuse a venue or a camera that is not there, before anything is computed."""
    if bool(into) != bool(camera):
        raise InputError("--into and --camera: the venue and one of its cameras go together")
    if into:
        require_camera(into, camera)


def give(into: Path | None, camera: str, keys: Sequence[Key], output: Output) -> None:
    """Print the keys of a camera, and write them into venue.toml where there is one."""
    for key in keys:
        output.say(key.line)
    if into:
        set_camera_keys(into, camera, keys)
        output.say(f"{into / 'venue.toml'} written: [cameras.{camera}]")
    else:
        output.say("for venue.toml: give --into VENUE and --camera NAME, or copy the lines")
