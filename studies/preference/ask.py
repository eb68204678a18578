"""Writes a page that asks people which of two compensated pictures they prefer."""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from procam.interfaces.cli._options import (
    CalibrationArgument,
    DbOption,
    Json,
    StateOption,
    TransferOption,
    WhiteNitsOption,
    WhiteOption,
)
from procam.interfaces.cli._output import Output
from procam.workflows.playout.frame import FrameSettings
from studies.preference.kit import make_kit
from studies.preference.page import page_renderer
from studies.preference.plan import PAGE, Plan
from studies.preference.wanted import Wanted

PROGRAM = "python -m studies.preference"
TRIAL_S = 10  # of a usual observer


def ask(  # noqa: PLR0913 - options of a command
    calibration: CalibrationArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to make.")],
    pictures: Annotated[
        list[Path],
        typer.Argument(metavar="PICTURE...", help="Dome masters: PNG, TIFF or EXR."),
    ],
    *,
    methods: Annotated[
        str,
        typer.Option(
            help="Two or more of none, exact, least-squares, perceptual; with commas between."
        ),
    ] = "exact,perceptual",
    repeats: Annotated[
        int, typer.Option(help="How often each observer compares each pair of pictures.")
    ] = 2,
    on_dome: Annotated[
        bool,
        typer.Option(
            "--on-dome",
            help="The dome shows the page: pictures are the direct light to send, as dome masters. "
            "Without it they are what the audience would see, for a monitor.",
        ),
    ] = False,
    db: DbOption = None,
    white_nits: WhiteNitsOption = None,
    white: WhiteOption = "summed",
    transfer: TransferOption = None,
    state: StateOption = None,
    json: Json = False,
) -> None:
    """Write a page that asks people which of two compensated pictures they prefer.

    OUT/page.html shows pictures one at a time and offers the answers as a file; `answers` analyses
    those. Which picture is of which method is in OUT/plan.json alone.
    """
    output = Output(json)
    settings = FrameSettings(
        state=state, white=white, transfer=transfer, db=db, white_nits=white_nits
    )
    names = tuple(name.strip() for name in methods.split(","))
    wanted = Wanted(pictures, names, repeats, on_dome, settings)
    command = f"{PROGRAM} {shlex.join(sys.argv[1:])}"
    plan, notes = output.follow(make_kit(calibration, out, wanted, command, page_renderer()))
    output.warn(notes)
    _summarise(out, plan, notes, output)


def _summarise(out: Path, plan: Plan, notes: list[str], output: Output) -> None:
    catch = sum(question.times for question in plan.questions if question.catch)
    pairs = ", ".join(f"{first} against {second}" for first, second in plan.pairs)
    document: dict[str, Any] = {
        "out": str(out),
        "page": str(out / PAGE),
        "plan": plan.id,
        "on_dome": plan.on_dome,
        "contents": [content.name for content in plan.contents],
        "methods": list(plan.methods),
        "pictures": len(plan.pictures),
        "trials": plan.trials,
        "catch_trials": catch,
        "notes": notes,
    }
    minutes = max(1, round(plan.trials * TRIAL_S / 60))
    caught = f", {catch} of them to see whether an observer looks at all" if catch else ""
    output.say(f"{out} written: {', '.join(document['contents'])}; {pairs}")
    output.say(f"each observer gives {plan.trials} answers{caught}; that takes about {minutes} min")
    where = "on the dome's server" if plan.on_dome else "on a monitor in a dark room"
    output.say(f"open {out / PAGE} {where}; then run: {PROGRAM} answers {out} ANSWERS.csv")
    output.finish(document)
