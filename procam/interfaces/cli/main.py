"""The `procam` command: its list of commands, and how errors end the process.

Each command is a module of this package, or of a group in it, with a function of the same name, whose
signature typer turns into options, and an `EXAMPLE`. A module is imported only when its command runs or
its own help is shown, so `procam --help` needs none of the libraries that compute.
"""

import gc
import json
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from procam.devices.interrupts import interruptible
from procam.errors import DeviceError, ProcamError
from procam.interfaces.cli._output import end_log, plain

BY_SIGNAL = 128  # plus a signal's number: the exit code of a process that it has ended
SETTINGS = {"help_option_names": ["-h", "--help"]}
# by panel of the list, in its order; a test compares the texts with the first lines of the functions.
# A name of two words is a command of a group.
PANELS = {
    "Before anything is bought": {
        "demo": "Calibrate a simulated dome, compensate a picture, and compare both with the truth.",
        "forecast": "Predict white and contrast of a dome or a room before anything is bought.",
    },
    "The venue": {
        "init": "Write a complete, commented venue.toml to start from.",
        "doctor": "Check that every device of a venue can be reached, exposed and resolved; exit 1 if not.",
        "calibrate": "Capture, solve and report in one run.",
        "refine": "Show the compensated picture, photograph it and correct the residual; a new calibration.",
        "state": "Measure the venue with its present audience and its own lamps; a new calibration.",
        "meter": "Make a calibration absolute with a hand meter; exit 1 if the two disagree.",
        "verify": "Say what has changed at a venue since it was calibrated, and why; exit 1 if anything has.",
        "recalibrate": "Measure the projectors again that have changed, and nothing else; a new calibration.",
        "report": "Write report.html and operator-sheet.html; exit 1 if a limit of the client is not kept.",
        "projector": "Query or control a projector over its serial remote control.",
    },
    "The show": {
        "compensate": "Take the scattered light out of dome masters.",
        "preview": "Write a page that shows a picture by each method beside its target, to choose by.",
        "export": "Write what another program needs to show a calibrated venue.",
    },
    "Step by step, and on a desk": {
        "session plan": "Write the pictures of a capture session, to show and photograph by hand.",
        "session capture": "Show the patterns and photograph them; a run that was stopped is resumed.",
        "session add": "Assign photographs taken by hand or by another program to the shots of a session.",
        "session undo": "Set all photographs of a camera aside, to begin again.",
        "session solve": "Calibrate from stored captures alone, and report; no device is touched.",
        "venue status": "List what was done at a venue, its calibrations, and which of them is in use.",
        "venue canvas": "Draw which part of a room lies where on the canvas that content is made for.",
        "venue show": "Print the figures of a calibration, and those of all over time to a plot or a table.",
        "venue use": "Use calibration N of a venue until a later one is made.",
        "venue compare": "Compare two calibrations of a rig; exit 1 if they differ by more than a rotation.",
        "venue prune": "Delete captures that keep_sessions in venue.toml does not keep.",
        "venue pack": "Write a session into one file that can be solved elsewhere.",
        "venue unpack": "Unpack a session that `procam venue pack` wrote, as a venue to solve.",
        "lens board": "Solve a camera's lens from photographs of a flat board; exit 1 if it fits badly.",
        "lens patterns": "Write the pictures of a code, for `procam decode` and `procam lens pair`.",
        "lens pair": "Solve a projector and a camera from a flat chessboard; exit 1 if it fits badly.",
        "lens response": "Solve how a camera encodes light, from photographs at three exposures or more.",
        "lens glare": "Measure a lens's veiling glare with a light trap in the middle of a bright surface.",
        "lens vignetting": "Measure how a lens darkens towards the rim, for venue.toml.",
        "decode": "Decode a folder of structured-light photographs; needs no venue.",
        "inspect": "Describe a file or folder that procam has written, and check that it is whole.",
    },
}
GROUPS = {
    "session": "A capture session step by step, driven or by hand.",
    "venue": "What was done at a venue, its calibrations, and sessions as files.",
    "lens": "Measure a camera, or a projector, on a desk.",
}
COMMANDS = {name: text for panel in PANELS.values() for name, text in panel.items()}


class LazyGroup(TyperGroup):
    """The commands of the list, or of one group, each imported only when it is needed."""

    def __init__(self, **settings: Any) -> None:
        name = settings["name"]
        self._prefix = f"{name} " if name in GROUPS else ""
        commands = _group(name) if name in GROUPS else _top()
        super().__init__(**settings | {"commands": commands})

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """The command that the arguments name, imported."""
        name, found, rest = super().resolve_command(ctx, args)
        if isinstance(found, LazyGroup) or not (name and found):
            return name, found, rest
        return name, load_command(self._prefix + name), rest


def _top() -> dict[str, Any]:
    """Commands and groups in the order of the list."""
    commands = dict[str, Any]()
    for panel, listed in PANELS.items():
        for name, text in listed.items():
            group, _, inner = name.partition(" ")
            if not inner:
                commands[name] = TyperCommand(name, help=text, rich_help_panel=panel)
            elif group not in commands:
                commands[group] = LazyGroup(
                    name=group,
                    help=GROUPS[group],
                    rich_help_panel=panel,
                    no_args_is_help=True,
                    context_settings=SETTINGS,
                )
    return commands


def _group(group: str) -> dict[str, Any]:
    """Commands of a group by their second word."""
    names = (name for name in COMMANDS if name.startswith(f"{group} "))
    return {
        inner: TyperCommand(inner, help=COMMANDS[name])
        for name in names
        for inner in [name.partition(" ")[2]]
    }


def load_command(name: str) -> Any:
    """Import the module of a command and make the command of its function."""
    gc.disable()  # it would look through all modules several times while they are made
    try:
        module = import_module(f"procam.interfaces.cli.{name.replace(' ', '.')}")
    finally:
        gc.enable()
    single, function = typer.Typer(add_completion=False), name.rpartition(" ")[2]
    example = f"Example: {module.EXAMPLE}"
    single.command(function, context_settings=SETTINGS, epilog=example)(getattr(module, function))
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


def main(run_command: Callable[[], object] = app) -> None:
    """Entry point: an error becomes one line; exit 2 for bad input, 1 for a failed device or check."""
    try:
        with interruptible(process_ends=True) as run:
            run_command()
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
