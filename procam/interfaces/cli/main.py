"""The `procam` command. Heavy imports wait until a command runs: `--help` stays quick."""

import os
import sys
import threading
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from procam.errors import DeviceError, InputError, ProcamError
from procam.interfaces.cli.app import CodeOption, Json, VenueArgument, app
from procam.interfaces.cli.output import Output

INTERRUPTED = 130


@app.command(epilog="Example: procam demo --out demo-run --preset standard")
def demo(
    out: Annotated[Path, typer.Option(help="Folder to make; an earlier demo is replaced.")] = Path(
        "demo-run"
    ),
    preset: Annotated[
        str, typer.Option(help="ideal, standard, realistic, faulty or server.")
    ] = "standard",
    judge: Annotated[
        str,
        typer.Option(help="Who traces the light that judges: rays, or mitsuba, a path tracer."),
    ] = "rays",
    json: Json = False,
) -> None:
    """Calibrate and clean a simulated dome, and judge the result against the truth."""
    from procam.interfaces.cli.demo import run_demo

    run_demo(out, preset, judge, Output(json))


@app.command(epilog="Example: procam init my-dome --template simulated-standard")
def init(
    venue: Annotated[Path, typer.Argument(help="Folder to make.")],
    template: Annotated[
        str,
        typer.Option(
            help="Which example to start from: by-hand, through-server, simulated-faulty, "
            "simulated-ideal, simulated-realistic, simulated-server or simulated-standard."
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Write a complete, commented venue.toml to start from.

    By-hand is for rigs of your own, through-server for domes behind a media server.
    """
    from procam.files.venue.load import template_names
    from procam.interfaces.cli.venues import run_init

    if not template:
        raise InputError(
            f"--template: got none, expected one of {', '.join(template_names())}; "
            "by-hand is for rigs of your own"
        )
    run_init(venue, template, Output(json))


@app.command(epilog="Example: procam doctor my-dome --behaviour")
def doctor(
    venue: VenueArgument,
    behaviour: Annotated[
        bool,
        typer.Option(
            "--behaviour",
            help="Also test each projector for settings that break calibration, such as dynamic "
            "black or white boost: 24 more photographs and two minutes each.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Check that all a venue names can be reached, exposed and resolved; exit 1 if it cannot.

    Photographs each projector about five times, says what to set, and leaves the projectors dark.
    """
    from procam.interfaces.cli.doctor import run_doctor

    run_doctor(venue, behaviour, Output(json))


@app.command(epilog="Example: procam capture my-dome --dry-run")
def capture(
    venue: VenueArgument,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say how many shots, minutes and GB.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the patterns and photograph them. Killed or unplugged, it resumes where it stopped."""
    from procam.interfaces.cli.venues import run_capture

    run_capture(venue, dry_run, Output(json))


@app.command(epilog="Example: procam solve my-dome/sessions/0001")
def solve(
    session: Annotated[Path, typer.Argument(help="Session folder, such as VENUE/sessions/0001.")],
    json: Json = False,
) -> None:
    """Calibrate from stored captures alone; no device is touched."""
    from procam.interfaces.cli.venues import run_solve

    run_solve(session, Output(json))


@app.command(epilog="Example: procam calibrate my-dome")
def calibrate(venue: VenueArgument, json: Json = False) -> None:
    """Capture, solve and report, in one go."""
    from procam.interfaces.cli.venues import run_calibrate

    run_calibrate(venue, Output(json))


@app.command(epilog="Example: procam refine my-dome --picture sky.exr")
def refine(
    venue: VenueArgument,
    picture: Annotated[
        Path | None, typer.Option(help="Dome master to refine on; a half sky if none is given.")
    ] = None,
    json: Json = False,
) -> None:
    """Show the compensated picture, photograph it, correct what is left; a new calibration."""
    from procam.interfaces.cli.venues import run_refine

    run_refine(venue, picture, Output(json))


@app.command(epilog="Example: procam state my-dome full")
def state(
    venue: VenueArgument,
    name: Annotated[str, typer.Argument(metavar="NAME", help="What to call it, such as full.")],
    ambient_only: Annotated[
        bool,
        typer.Option(
            "--ambient-only",
            help="Only the room's own light; no projector is lit, nothing checked.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Measure the house as it is now, with its audience and the show's own lamps; a new calibration.

    Leave exit signs and aisle lights as in a show. Photographs the room dark, then five pictures of
    each projector, and adds the state to what the newest calibration knows. The camera must stand where
    it stood then.
    """
    from procam.interfaces.cli.house import run_state

    run_state(venue, name, ambient_only, Output(json))


@app.command(epilog="Example: procam report my-dome")
def report(
    where: Annotated[Path, typer.Argument(metavar="VENUE|SESSION", help="What to report on.")],
    json: Json = False,
) -> None:
    """Write report.html, one self-contained file."""
    from procam.interfaces.cli.pictures import run_report

    run_report(where, Output(json))


@app.command(epilog="Example: procam patterns my-dome --out pictures --movie")
def patterns(
    out: Annotated[Path, typer.Option(help="New folder for the pictures.")],
    venue: Annotated[
        Path | None, typer.Argument(help="Venue folder: all pictures of a visit, numbered.")
    ] = None,
    size: Annotated[
        str, typer.Option(help="Without a venue: projector size, such as 1280x800.")
    ] = "",
    code: CodeOption = "micro-phase",
    movie: Annotated[
        bool, typer.Option("--movie", help="With a venue: also one movie per projector.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the pictures of a venue's visit, or of one code, to be shown by any means.

    With a venue every picture carries its number, and `procam ingest` sorts the photographs.
    """
    if venue is None:
        if movie:
            raise InputError("--movie: got no VENUE, expected one: a movie shows a venue's visit")
        if not size:
            raise InputError("patterns: got no VENUE and no --size, expected one of them")
        from procam.interfaces.cli.decoding import run_patterns

        run_patterns(size, out, code, Output(json))
        return
    if size or code != "micro-phase":
        raise InputError(
            f"patterns: got --size or --code beside {venue}, expected none: venue.toml has the sizes, "
            "and a visit its code"
        )
    from procam.interfaces.cli.external import run_venue_patterns

    run_venue_patterns(venue, out, movie, Output(json))


@app.command(
    epilog="Example: procam ingest my-dome/sessions/hand-0001 --camera zenith --photos DCIM"
)
def ingest(
    session: Annotated[Path, typer.Argument(help="Session made by `procam patterns VENUE`.")],
    camera: Annotated[str, typer.Option(help="Camera's name in venue.toml.")],
    photos: Annotated[Path, typer.Option(help="Folder of linear 16-bit TIFF, PNG or JPEG.")],
    index: Annotated[
        Path | None, typer.Option(help="CSV of lines file,shot; goes before the numbers seen.")
    ] = None,
    json: Json = False,
) -> None:
    """Sort photographs taken by hand or by another program behind the shots of a session.

    They are known by the number seen in them, else by their place among the others. What is missing
    or left out is told; run it again with more photographs, it adds only what is missing.
    """
    from procam.interfaces.cli.external import run_ingest

    run_ingest(session, camera, photos, index, Output(json))


@app.command(epilog="Example: procam projector my-dome north shutter closed")
def projector(
    venue: VenueArgument,
    name: Annotated[str, typer.Argument(metavar="ID", help="Projector's name in venue.toml.")],
    action: Annotated[str, typer.Argument(help="state, on, off, input, shutter or hours.")],
    value: Annotated[
        str, typer.Argument(help="open or closed for shutter; a source code for input.")
    ] = "",
    json: Json = False,
) -> None:
    """Ask or tell a projector over its serial remote control."""
    from procam.interfaces.cli.venues import run_projector

    run_projector(venue, name, action, value, Output(json))


from procam.interfaces.cli import desk_commands, show_commands, tools  # noqa: E402, F401 (they register)


def main() -> None:
    """Entry point: errors become one clear line; 2 for bad input, 1 for a failed device or check."""
    try:
        app()
    except DeviceError as error:
        _leave(_complain(error, 1))
    except ProcamError as error:
        _leave(_complain(error, 2))
    except OSError as error:  # a full disk, a folder that may not be written
        from procam.interfaces.cli.system_errors import worded

        _leave(_complain(ProcamError(worded(error)), 2))
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer says nothing when it ends for Ctrl-C
            _complain(
                ProcamError("stopped; projectors are dark, the run can be resumed"), INTERRUPTED
            )
            _leave(INTERRUPTED)
        raise


def _leave(code: int) -> NoReturn:
    """End the process: at once if a thread still waits at a pipe, of which libraries would complain."""
    from procam.workflows.playout.pipeline import THREAD

    if any(thread.name == THREAD for thread in threading.enumerate()):
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _complain(error: ProcamError, code: int) -> int:
    sys.stderr.write(f"procam: {error}\n")
    return code
