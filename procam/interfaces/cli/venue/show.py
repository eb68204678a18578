"""`procam venue show`: the figures of a calibration, and of all of them over time."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.atomic import write_text
from procam.files.calibration import load_dome
from procam.files.history.read import figures_csv, list_figures
from procam.files.versions import chosen_calibration, venue_of_calibration
from procam.interfaces.cli._options import FromArgument, Json
from procam.interfaces.cli._output import Output, as_dicts
from procam.interfaces.cli._paths import check_out

EXAMPLE = "procam venue show my-dome@3"
Plot = Annotated[Path | None, typer.Option(metavar="FILE.png", help="Plot figures over time too.")]
PlottedFigures = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="With --plot: these figures, such as feedback.G."),
]
Csv = Annotated[
    Path | None,
    typer.Option(metavar="FILE.csv", help="Write the figures of all calibrations as CSV too."),
]


def show(
    start: FromArgument,
    *,
    plot: Plot = None,
    figure: PlottedFigures = None,
    csv: Csv = None,
    json: Json = False,
) -> None:
    """Print the figures of a calibration, and those of all over time to a plot or a table."""
    if figure and not plot:
        raise InputError("--figure: it is for --plot FILE.png")
    for option, path, suffix in (("--plot", plot, ".png"), ("--csv", csv, ".csv")):
        if path:
            check_out(path, suffix, option=option)
    output, chosen = Output(json), chosen_calibration(start)
    calibration = load_dome(chosen)
    output.say(str(chosen))
    output.table(calibration.quality)
    if calibration.absolute:
        nits, sigma = calibration.absolute.nits_per_unit
        output.say(f"  reference white {nits:.4g} +- {sigma:.2g} cd/m2, by a hand meter")
    notes = output.notes(calibration, ())
    document = {
        "calibration": str(chosen),
        "figures": as_dicts(calibration.quality),
        "notes": notes,
    }
    if plot:
        document |= {"plot": str(plot), "plotted": _plot(start, plot, figure or [], output)}
    if csv:
        text = figures_csv(venue_of_calibration(start))
        write_text(csv, text)
        output.say(f"{csv} written, {text.count(chr(10)) - 1} figures")
        document |= {"csv": str(csv)}
    output.finish(document)


def _plot(start: Path, out: Path, names: list[str], output: Output) -> list[str]:
    from procam.interfaces.plots.trends import plot_trends

    drawn = plot_trends(list_figures(venue_of_calibration(start)), names, out)
    output.say(f"{out} written: {', '.join(drawn)}")
    return drawn
