"""`procam venue unpack`: a venue made of a file that `procam venue pack` wrote."""

from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from procam.files.bundle.names import SESSION
from procam.files.bundle.read import open_bundle
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli.venue.pack import content, document, say_left_out

EXAMPLE = "procam venue unpack my-dome.zip copy"


def unpack(
    file: Annotated[Path, typer.Argument(metavar="FILE.zip", help="Of `procam venue pack`.")],
    venue: Annotated[Path, typer.Argument(metavar="VENUE", help="Venue folder to make.")],
    json: Json = False,
) -> None:
    """Unpack a session that `procam venue pack` wrote, as a venue to solve."""
    output = Output(json)
    manifest = open_bundle(file, venue)
    session = venue / SESSION
    output.say(f"{venue} written: {content(manifest)}, by procam {manifest.procam}")
    say_left_out(manifest, output)
    output.say(f"solve it: procam session solve {quote(str(session))}")
    output.finish(document(manifest) | {"venue": str(venue), "session": str(session)})
