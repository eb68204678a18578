"""`procam venue pack`: a session as one file for other people."""

from pathlib import Path
from typing import Annotated

import typer

from procam.files.bundle.manifest import Manifest
from procam.files.bundle.write import writing_bundle
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.generators import converted
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import check_out
from procam.workflows.capture.newest import solved_session, venue_of
from procam.workflows.events import Event

EXAMPLE = "procam venue pack my-dome my-dome.zip"
MB = 1e6


def pack(
    start: Annotated[
        Path,
        typer.Argument(
            metavar="VENUE@N",
            help="Venue, for the session of its calibration in use; VENUE@3 for that of calibration 3; or a "
            "session's folder.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT.zip", help="File to write.")],
    json: Json = False,
) -> None:
    """Write a session into one file that can be solved elsewhere.

    Photographs, patterns, numbers of venue.toml that a solve reads and the names of devices get in; nothing
    else does: no command, port, host, password, comment, date or name of a file or mark. Of a file that
    somebody else packed no more gets out either.
    """
    output = Output(json)
    check_out(out, ".zip", option="OUT.zip")
    folder = solved_session(start)
    written = writing_bundle(load_venue(venue_of(folder)), Session(folder), out)
    manifest = output.follow(
        converted(written, lambda done: Event("pack", *done, "photographs written"))
    )
    size = out.stat().st_size
    output.say(f"{out} written, {size / MB:.1f} MB: {content(manifest)} of {folder}")
    say_left_out(manifest, output)
    output.say(
        "photographs, the mesh of a room and the names of devices are in it; look at them before you give "
        "it away"
    )
    output.finish(document(manifest) | {"bundle": str(out), "bytes": size})


def say_left_out(manifest: Manifest, output: Output) -> None:
    """Print what of venue.toml is not in a packed session."""
    for line in manifest.redacted:
        output.say(f"left out: {line}")


def content(manifest: Manifest) -> str:
    """How many photographs a packed session has."""
    return f"{manifest.frames} of {manifest.planned} photographs"


def document(manifest: Manifest) -> dict[str, object]:
    """A packed session for machines."""
    return manifest.model_dump(include={"procam", "frames", "planned", "redacted"})
