"""`procam bundle`: a session as one file for other people, and back."""

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from procam.errors import InputError
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output

if TYPE_CHECKING:
    from collections.abc import Iterator

    from procam.files.bundle.manifest import Manifest
    from procam.files.bundle.write import Written
    from procam.workflows.events import Event

EXAMPLE = "procam bundle my-dome --out my-dome.zip"
MB = 1e6


def bundle(
    venue: Annotated[
        Path,
        typer.Argument(
            metavar="VENUE|SESSION",
            help="Session folder, or a venue for the session of its calibration in use; with --open the "
            "venue folder to make.",
        ),
    ],
    out: Annotated[Path | None, typer.Option(metavar="FILE.zip", help="File to write.")] = None,
    open_: Annotated[
        Path | None, typer.Option("--open", metavar="FILE.zip", help="Bundle to unpack into VENUE.")
    ] = None,
    json: Json = False,
) -> None:
    """Write a session into one file that can be solved elsewhere, or open such a file.

    Photographs, patterns, numbers of venue.toml that a solve reads and the names of devices get in; nothing
    else does: no command, port, host, password, comment, date or name of a file or mark. Of a bundle that
    somebody else made no more gets out either.
    """
    if (out is None) == (open_ is None):
        raise InputError("--out, --open: give one of them, and the name of a .zip file")
    output = Output(json)
    if out is not None:
        _write(venue, out, output)
    elif open_ is not None:
        _open(open_, venue, output)


def _write(path: Path, out: Path, output: Output) -> None:
    from procam.files.bundle import writing_bundle
    from procam.files.session import Session
    from procam.files.venue.load import load_venue
    from procam.interfaces.cli._paths import check_out
    from procam.workflows.capture.newest import chosen_session, venue_of

    check_out(out, ".zip")
    folder = chosen_session(path)
    written = writing_bundle(load_venue(venue_of(folder)), Session(folder), out)
    manifest: Manifest = output.follow(_events(written))["manifest"]
    size = out.stat().st_size
    output.say(f"{out} written, {size / MB:.1f} MB: {_content(manifest)} of {folder}")
    _say_left_out(manifest, output)
    output.say(
        "photographs and the names of devices are in it; look at them before you give it away"
    )
    output.finish(_document(manifest) | {"bundle": str(out), "bytes": size})


def _open(file: Path, venue: Path, output: Output) -> None:
    from procam.files.bundle import open_bundle
    from procam.files.bundle.names import SESSION

    manifest = open_bundle(file, venue)
    session = venue / SESSION
    output.say(f"{venue} written: {_content(manifest)}, by procam {manifest.procam}")
    _say_left_out(manifest, output)
    output.say(f"solve it: procam solve {quote(str(session))}")
    output.finish(_document(manifest) | {"venue": str(venue), "session": str(session)})


def _say_left_out(manifest: "Manifest", output: Output) -> None:
    for line in manifest.redacted:
        output.say(f"left out: {line}")


def _events(written: "Iterator[Written]") -> "Iterator[Event]":
    from procam.workflows.events import Event

    for each in written:
        data = {"manifest": each.manifest}
        yield Event("bundle", each.done, each.total, "photographs written", data)


def _content(manifest: "Manifest") -> str:
    return f"{manifest.frames} of {manifest.planned} photographs"


def _document(manifest: "Manifest") -> dict[str, object]:
    return manifest.model_dump(include={"procam", "frames", "planned", "redacted"})
