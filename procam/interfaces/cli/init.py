"""`procam init`: a venue folder to start from."""

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.venue.load import create_venue, load_venue, template_names
from procam.files.venue.tables import BY_HAND
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output

EXAMPLE = "procam init my-dome --template simulated-standard"


def init(
    venue: Annotated[Path, typer.Argument(help="Folder to make.")],
    template: Annotated[
        str,
        typer.Option(
            help="Which example to start from: by-hand, through-server, simulated-box, "
            "simulated-cylinder, simulated-faulty, simulated-ideal, simulated-realistic, "
            "simulated-room, simulated-server, simulated-six-projectors, simulated-small or "
            "simulated-standard."
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Write a complete, commented venue.toml to start from.

    By-hand is for rigs of your own, through-server for domes behind a media server.
    """
    if not template:
        raise InputError(
            f"--template is missing: choose one of {', '.join(template_names())}; by-hand is for rigs "
            "of your own"
        )
    path = create_venue(venue, template) / "venue.toml"
    by_hand = any(c.backend == BY_HAND for c in load_venue(venue).table.cameras.values())
    first = (
        f"plan {quote(str(venue))} PICTURES"
        if by_hand
        else f"capture {quote(str(venue))} --dry-run"
    )
    output = Output(json)
    output.say(f"{path} written; edit it, then run: procam session {first}")
    output.finish({"venue": str(path)})
