"""Figures of a venue over time, with their 95 % intervals."""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from procam.errors import InputError
from procam.files.history.read import FigureEntry
from procam.interfaces.plots.figure import finish, new_figure, save_figure, title_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_PANELS = 12
USUAL = ("feedback.", "albedo.", "white_in_camera.")  # drawn first
SHOWN = 8  # names in a message
TWO = 2  # values make a trend
COLOUR, FAILED = "#0063a6", "#c44e00"


def plot_trends(entries: Sequence[FigureEntry], names: Sequence[str], out: Path) -> list[str]:
    """Draw figures over time, a panel each; returns their names.

    Those of the given names, or the usual ones and others that have two values or more. Runs are in their
    order, whatever the clock said.

    Raises
    ------
    InputError
        A figure was never measured, or nothing was measured twice.
    """
    known = [e.name for e in entries if e.value is not None]
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"--figure {unknown[0]}: no run has measured it; {_choice(known)}")
    drawn = list(dict.fromkeys(names)) or _usual(known)
    if not drawn:
        raise InputError(
            "--plot: no figure was measured twice yet, and one value shows no change; plot after the next "
            "calibration, or name a figure with --figure"
        )
    columns = min(3, len(drawn))
    rows = -(-len(drawn) // columns)
    figure = new_figure(3.6 * columns, 2.3 * rows + 0.3)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, name in zip(panels, drawn, strict=False):
        _draw(axes, name, [e for e in entries if e.name == name and e.value is not None])
    for axes in panels[len(drawn) :]:
        axes.set_visible(False)
    finish([*panels[: len(drawn)]])
    save_figure(figure, out)
    return drawn


def _choice(known: Sequence[str]) -> str:
    """Names of figures that can be drawn, in the words of a refusal."""
    names = list(dict.fromkeys(known))
    if not names:
        return "this venue has no figures yet, run procam calibrate first"
    more = f" and {len(names) - SHOWN} more, which --csv lists" if len(names) > SHOWN else ""
    return f"choose from {', '.join(names[:SHOWN])}{more}"


def _usual(known: Sequence[str]) -> list[str]:
    twice = [name for name in dict.fromkeys(known) if known.count(name) >= TWO]
    first = [name for name in twice if name.startswith(USUAL)]
    return [*first, *(name for name in twice if name not in first)][:MOST_PANELS]


def _draw(axes: "Axes", name: str, entries: Sequence[FigureEntry]) -> None:
    places = range(len(entries))
    values = [float(e.value) for e in entries if e.value is not None]
    errors = [1.96 * (e.sigma or 0.0) for e in entries]
    axes.errorbar(places, values, errors, color=COLOUR, marker="o", ms=4, lw=1.2, capsize=2.5)
    missed = [i for i in places if entries[i].passed == 0]
    axes.plot([*missed], [values[i] for i in missed], "o", ms=7, mfc="none", color=FAILED)
    for goal in {e.goal for e in entries if e.goal is not None}:
        axes.axhline(goal, color=FAILED, ls="--", lw=1)
    step = max(1, -(-len(entries) // 5))
    axes.set_xticks([*places][::step])
    axes.set_xticklabels([_label(e) for e in entries[::step]], fontsize=7)
    unit = "" if entries[-1].unit == "-" else f" [{entries[-1].unit}]"
    title_axes(axes, name + unit, size=9)


def _label(entry: FigureEntry) -> str:
    when = datetime.fromisoformat(entry.started_at).astimezone()
    return f"{entry.calibration or f'run {entry.run}'}\n{when:%Y-%m-%d}"
