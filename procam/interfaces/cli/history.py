"""`procam history`: the runs, calibrations and figures of a venue since it was set up."""

from collections.abc import Iterator
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from procam.errors import FileFormatError, InputError
from procam.files.history.differences import figure_differences, stated_figures
from procam.files.history.read import (
    RunEntry,
    changed_files,
    clock_went_back,
    figures_csv,
    list_figures,
    list_runs,
)
from procam.files.versions import calibration_in_use, list_calibrations, name_in_use
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._plain import plain_line

if TYPE_CHECKING:
    from procam.files.session import Session

EXAMPLE = "procam history my-dome --compare 1 3"
LATEST = 20
Everything = Annotated[bool, typer.Option("--all", help=f"List all runs, not the latest {LATEST}.")]
Compare = Annotated[
    tuple[int, int] | None,
    typer.Option(metavar="A B", help="Compare the figures of two calibrations."),
]
Plot = Annotated[Path | None, typer.Option(metavar="FILE.png", help="Plot figures over time.")]
PlottedFigures = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="With --plot: these figures, such as feedback.G."),
]
Csv = Annotated[Path | None, typer.Option(metavar="FILE.csv", help="Write all figures as CSV.")]
Restore = Annotated[
    int | None, typer.Option(metavar="N", help="Use calibration N until a later one is made.")
]
Prune = Annotated[
    bool,
    typer.Option(
        "--prune",
        help="Delete captures that keep_sessions in venue.toml does not keep.",
    ),
]


def history(
    venue: VenueArgument,
    *,
    everything: Everything = False,
    compare: Compare = None,
    plot: Plot = None,
    figure: PlottedFigures = None,
    csv: Csv = None,
    restore: Restore = None,
    prune: Prune = False,
    json: Json = False,
) -> None:
    """List what was done at a venue, compare its calibrations, and go back to one of them.

    Calibrations are never overwritten. The one in use is what refine, state, verify, report and forecast
    start from, and what compensate, warp and track take where they are given the venue.
    """
    _check_venue(venue)
    output = Output(json)
    _check_one(compare, plot, csv, restore, prune or None)
    if figure and not plot:
        raise InputError("--figure: it is for --plot FILE.png")
    if compare:
        _compare(venue, compare, output)
    elif plot:
        _plot(venue, plot, figure or [], output)
    elif csv:
        _export(venue, csv, output)
    elif restore is not None:
        _restore(venue, restore, output)
    elif prune:
        _prune(venue, output)
    else:
        _list(venue, everything, output)


def _check_venue(venue: Path) -> None:
    if not (venue / "venue.toml").is_file() and not list_calibrations(venue):
        raise InputError(f"{venue}: this is no venue; give a folder with a venue.toml")


def _check_one(*wanted: object) -> None:
    if sum(each is not None for each in wanted) > 1:
        raise InputError("--compare, --plot, --csv, --restore, --prune: give one of them at a time")


def _list(venue: Path, everything: bool, output: Output) -> None:
    runs, there = list_runs(venue), list_calibrations(venue)
    shown = runs if everything else runs[-LATEST:]
    output.say(" run  started (local)      seconds  command     ended    calibration")
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
    return f"{run.id:4}  {when:20} {spent:>8}  {run.command:10}  {run.outcome:8} {rest}".rstrip()


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


def _compare(venue: Path, pair: tuple[int, int], output: Output) -> None:
    """Print figures of two calibrations, and the differences in their standard errors."""
    first, second = (_numbered(venue, number).name for number in pair)
    for name in (first, second):
        if not stated_figures(venue, name):
            raise InputError(
                f"{venue}: calibration {name} has no figures; `procam inspect` says what is wrong with it"
            )
    output.say(f"{'figure':34} {first:>12} {second:>12} {'difference':>12}  in sigmas")
    rows = figure_differences(venue, first, second)
    for row in rows:
        values = " ".join(f"{_short(value):>12}" for value in (row.a, row.b, row.difference))
        mark = " *" if row.is_marked else ""
        output.say(f"{row.name:34} {values}  {_short(row.sigmas, '+.1f')}{mark}".rstrip())
    paths = f"{venue}/calibrations/{first} {venue}/calibrations/{second}"
    output.say(f"directions, areas and the probable cause: procam compare {paths}")
    output.finish({"a": first, "b": second, "figures": [asdict(row) for row in rows]})


def _short(value: float | None, form: str = ".5g") -> str:
    return "" if value is None else format(value, form)


def _plot(venue: Path, out: Path, names: list[str], output: Output) -> None:
    from procam.interfaces.cli._paths import check_out
    from procam.interfaces.plots.trends import plot_trends

    check_out(out, ".png", option="--plot")
    drawn = plot_trends(list_figures(venue), names, out)
    output.say(f"{out} written: {', '.join(drawn)}")
    output.finish({"plot": str(out), "figures": drawn})


def _export(venue: Path, out: Path, output: Output) -> None:
    from procam.files.atomic import write_text
    from procam.interfaces.cli._paths import check_out

    check_out(out, ".csv", option="--csv")
    text = figures_csv(venue)
    write_text(out, text)
    output.say(f"{out} written, {text.count(chr(10)) - 1} figures")
    output.finish({"csv": str(out), "figures": text.count("\n") - 1})


def _restore(venue: Path, number: int, output: Output) -> None:
    from procam.files.history.read import verify_unchanged
    from procam.files.history.record import recorded
    from procam.files.session import Session
    from procam.files.versions import calibrated_session, use_calibration

    chosen = _numbered(venue, number)
    verify_unchanged(venue, chosen)
    with recorded(venue, "history") as run:
        use_calibration(venue, chosen)
        run.message = f"back to {chosen.name}"
    output.say(f"{chosen} is in use")
    session = Session(venue / "sessions" / calibrated_session(venue))
    notes = [_no_photographs(session)] if session.is_pruned else []
    output.warn(notes)
    output.finish({"calibration": str(chosen), "notes": notes})


def _no_photographs(session: "Session") -> str:
    return (
        f"the photographs of its session {session.directory.name} were deleted: verify, recalibrate and "
        "solve cannot use it. Restore them from a backup, or calibrate again"
    )


def _numbered(venue: Path, number: int) -> Path:
    there = {int(path.name): path for path in list_calibrations(venue)}
    if number not in there:
        names = ", ".join(map(str, there)) or "none"
        raise InputError(f"{venue} has no calibration {number}, only {names}; choose one of them")
    return there[number]


def _prune(venue: Path, output: Output) -> None:
    from procam.files.venue.load import load_venue
    from procam.workflows.prune import prune_captures

    pruned = prune_captures(load_venue(venue))
    gigabytes = sum(pruned.values()) / 1e9
    names = ", ".join(pruned) or "nothing"
    output.say(f"captures deleted: {names}, {gigabytes:.2f} GB")
    output.finish({"sessions": list(pruned), "gigabytes": round(gigabytes, 4)})
