"""The `procam` command: its list of commands, and how errors end the process.

Each command is a module of this package with a function of the same name, whose signature typer turns
into options, and an `EXAMPLE`. A module is imported only when its command runs or its own help is
shown, so `procam --help` needs none of the libraries that compute.
"""

import gc
import json
import os
import sys
import traceback
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from procam.devices.interrupts import interruptible
from procam.errors import DeviceError, ProcamError
from procam.interfaces.cli._plain import plain
from procam.interfaces.cli._run_log import end_log

BY_SIGNAL = 128  # plus a signal's number: the exit code of a process that it has ended
SETTINGS = {"help_option_names": ["-h", "--help"]}
# by panel of the list, in its order; a test compares the texts with the first lines of the functions
PANELS = {
    "Before anything is bought": {
        "demo": "Calibrate a simulated dome, compensate a picture, and compare both with the truth.",
        "forecast": "Predict white and contrast of a dome before anything is bought.",
    },
    "The venue": {
        "init": "Write a complete, commented venue.toml to start from.",
        "doctor": "Check that every device of a venue can be reached, exposed and resolved; exit 1 if not.",
        "capture": "Show the patterns and photograph them; a run that was stopped is resumed.",
        "solve": "Calibrate from stored captures alone, and report; no device is touched.",
        "calibrate": "Capture, solve and report in one run.",
        "refine": "Show the compensated picture, photograph it and correct the residual; a new calibration.",
        "state": "Measure the venue with its present audience and its own lamps; a new calibration.",
        "verify": "Say what has changed at a venue since it was calibrated, and why; exit 1 if anything has.",
        "recalibrate": "Measure the projectors again that have changed, and nothing else; a new calibration.",
        "history": "List what was done at a venue, compare its calibrations, and go back to one of them.",
        "report": "Write report.html, one self-contained file; exit 1 if a limit of the client is not kept.",
        "bundle": "Write a session into one file that can be solved elsewhere, or open such a file.",
        "projector": "Query or control a projector over its serial remote control.",
    },
    "By hand": {
        "patterns": "Write the pictures of a venue's capture session, or of one code, to show by any means.",
        "ingest": "Assign photographs taken by hand or by another program to the shots of a session.",
    },
    "The show": {
        "compensate": "Take the scattered light out of dome masters.",
        "preview": "Write a page that shows a picture by each method beside its target, to choose by.",
        "warp": "Make each projector's frames: warp, blend, colour, response.",
        "track": "Write what a player needs to compensate a show by itself, without encoding it anew.",
        "ask": "Write a page that asks people which of two compensated pictures they prefer.",
        "answers": "Analyse what people answered: which method they prefer, how sure that is.",
    },
    "Camera and projector": {
        "response": "Solve how a camera encodes light, from photographs at three exposures or more.",
        "glare": "Measure a lens's veiling glare with a light trap in the middle of a bright surface.",
        "vignetting": "Measure how a lens darkens towards the rim; prints the line for venue.toml.",
        "camera": "Solve a camera's lens from photographs of a flat board; exit 1 if it fits badly.",
        "pair": "Solve a projector and a camera from a flat chessboard; exit 1 if it fits badly.",
        "decode": "Decode a folder of structured-light photographs; needs no venue.",
    },
    "Checks": {
        "judge": "Compare a calibration with the truth; exit 1 if a figure misses its goal.",
        "compare": "Compare two calibrations of a rig; exit 1 if they differ by more than a rotation.",
        "inspect": "Describe a file or folder that procam has written, and check that it is whole.",
        "reproduce": "Remake figures and studies of the documentation; without a NAME, list them.",
        "meter": "Make a calibration absolute with a hand meter; exit 1 if the two disagree.",
    },
}
COMMANDS = {name: text for panel in PANELS.values() for name, text in panel.items()}


class LazyGroup(TyperGroup):
    """The commands of the list, each imported only when it is needed."""

    def __init__(self, **settings: Any) -> None:
        placeholders = {
            name: TyperCommand(name, help=text, rich_help_panel=panel)
            for panel, commands in PANELS.items()
            for name, text in commands.items()
        }
        super().__init__(**settings | {"commands": placeholders})

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the arguments name, imported."""
        name, placeholder, rest = super().resolve_command(ctx, args)
        return name, load_command(name) if name and placeholder else None, rest


def load_command(name: str) -> Any:
    """Import the module of a command and make the command of its function."""
    gc.disable()  # it would look through all modules several times while they are made
    try:
        module = import_module(f"procam.interfaces.cli.{name}")
    finally:
        gc.enable()
    single = typer.Typer(add_completion=False)
    example = f"Example: {module.EXAMPLE}"
    single.command(name, context_settings=SETTINGS, epilog=example)(getattr(module, name))
    return typer.main.get_command(single)


app = typer.Typer(
    name="procam",
    cls=LazyGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=SETTINGS,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        sys.stdout.write(f"procam {version('procam')}\n")
        raise typer.Exit


@app.callback()
def procam(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Calibrate a projection dome with cameras, and remove bounced light from its pictures.

    Start with `procam demo`.
    """


def main() -> None:
    """Entry point: an error becomes one line; exit 2 for bad input, 1 for a failed device or check."""
    try:
        with interruptible(process_ends=True) as run:
            app()
    except DeviceError as error:
        _end(str(error), 1)
    except ProcamError as error:
        _end(str(error), 2)
    except OSError as error:  # a full disk, a folder without permission
        from procam.interfaces.cli._system_errors import worded

        _end(worded(error), 2)
    except BaseException as error:  # a library that a signal met while it loads says ImportError
        if run.stopped_by is not None:  # typer prints nothing when a signal ends it
            dark = "; all projectors are dark" if run.left_dark else ""
            usual = isinstance(error, (KeyboardInterrupt, SystemExit))
            why = "" if usual else f" ({type(error).__name__}: {error})"
            _end(f"stopped{dark}{why}. Run the same command again", BY_SIGNAL + run.stopped_by)
        end_log(_how_it_ended(error))
        if message := _unprinted(error):
            _print_error(message, error.code if isinstance(error, SystemExit) else 1)
        raise


def _how_it_ended(error: BaseException) -> str:
    """For the log: the exit code, or the traceback of an unexpected error."""
    if isinstance(error, SystemExit):
        return f"exit code {error.code or 0}"
    return "".join(traceback.format_exception(error))


def _unprinted(error: BaseException) -> str:
    """The message that --json has not printed yet: a wrong option, or an unexpected error; "" for none."""
    if not isinstance(error, SystemExit):
        return (
            f"unexpected {type(error).__name__}: {error}. This is a mistake in procam; report it with the "
            "lines on stderr"
        )
    cause = error.__context__  # typer has printed it for people
    if isinstance(cause, typer.Abort):
        return "aborted; run the same command again"
    return str(getattr(cause, "format_message", str)())


def _print_error(message: str, code: object) -> None:
    """With --json scripts get an error as a document too, unless frames go to stdout."""
    if "-" in sys.argv:
        return
    with suppress(OSError):  # the pipe has no reader
        if "--json" in sys.argv:
            document = {"error": message, "exit_code": code}
            sys.stdout.write(json.dumps(document, indent=1) + "\n")
        sys.stdout.flush()


def _end(message: str, code: int) -> NoReturn:
    """Print the message and end the process, at once if a thread still waits at a pipe."""
    end_log(f"exit code {code}: {message}")
    sys.stderr.write(f"procam: {plain(message)}\n")
    _print_error(message, code)
    threads = sys.modules.get("procam.threads")
    if threads and threads.any_running():
        sys.stderr.flush()
        os._exit(code)  # a regular exit would wait for that thread, and libraries would complain
    sys.exit(code)
