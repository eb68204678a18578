"""`procam venue status`: the runs and calibrations of a venue since it was set up."""

from collections.abc import Iterator
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from procam.errors import FileFormatError, InputError
from procam.files.history.read import RunEntry, changed_files, clock_went_back, list_runs
from procam.files.versions import calibration_in_use, list_calibrations, name_in_use
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output, plain_line

EXAMPLE = "procam venue status my-dome"
LATEST = 20


def status(
    venue: VenueArgument,
    everything: Annotated[
        bool, typer.Option("--all", help=f"List all runs, not the latest {LATEST}.")
    ] = False,
    json: Json = False,
) -> None:
    """List what was done at a venue, its calibrations, and which of them is in use."""
    if not (venue / "venue.toml").is_file() and not list_calibrations(venue):
        raise InputError(f"{venue}: this is no venue; give a folder with a venue.toml")
    output, runs, there = Output(json), list_runs(venue), list_calibrations(venue)
    shown = runs if everything else runs[-LATEST:]
    output.say(" run  started (local)      seconds  command          ended    calibration")
    for run in shown:
        output.say(_row(run))
    if len(shown) < len(runs):
        output.say(f"and {len(runs) - len(shown)} earlier runs; see them with --all")
    output.say("")
    for line in _calibrations(venue, there):
        output.say(line)
    back = clock_went_back(runs)
    if back:
        output.warn([_back(back)])
    output.finish(
        {
            "runs": [asdict(run) for run in shown],
            "calibrations": [path.name for path in there],
            "in_use": name_in_use(venue),
            "clock_went_back": back,
        }
    )


def _row(run: RunEntry) -> str:
    when = datetime.fromisoformat(run.started_at).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    spent = "" if run.elapsed_s is None else f"{run.elapsed_s:.1f}"
    written = f"wrote {run.written}" if run.written else ""
    rest = "; ".join(part for part in (written, plain_line(run.message)) if part)
    return f"{run.id:4}  {when:20} {spent:>8}  {run.command:15}  {run.outcome:8} {rest}".rstrip()


def _calibrations(venue: Path, there: list[Path]) -> Iterator[str]:
    if not there:
        yield "no calibration yet"
        return
    try:
        used = calibration_in_use(venue)
    except FileFormatError as error:
        yield str(error)
        return
    yield f"calibrations: {', '.join(path.name for path in there)}; {used.name} is in use"
    if changed := [Path(name).name for name in changed_files(venue, used)]:
        yield f"CHANGED  {used.name}: {', '.join(changed)} changed since procam wrote it"


def _back(back: list[int]) -> str:
    runs = ", ".join(map(str, back[:5]))
    return (
        f"the clock went back before run {runs}: times of runs before and after cannot be compared, their "
        "order is right"
    )
