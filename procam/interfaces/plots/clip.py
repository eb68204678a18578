"""Pictures of a clip: its report over time, and the steps of compensating one frame."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procam.arrays import BoolArray, FloatArray
from procam.interfaces.plots.figure import (
    CHANNELS,
    INK,
    LIMITS,
    add_legend_squares,
    brightest,
    finish,
    light_colours,
    new_figure,
    save_figure,
    show_dome,
    title_axes,
)
from procam.maths.geometry.sphere import master_solid_angles
from procam.workflows.playout.explain import Explained

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LIMIT_NAMES = ("exact", "too bright: black is not dark enough", "too dark", "not lit, or protected")
PANELS = (  # title, unit, and columns of the report with a factor and whether they are thin
    ("Scattered light removed", "scatter level s, per colour", [("s", 1, False)]),
    (
        "Light asked for (thin) and light sent (thick)",
        "flux [rel sr]",
        [("flux_in", 1, True), ("flux_out", 1, False)],
    ),
    (
        "At a limit: at full light (up), at black (down)",
        "lit dome [%]",
        [("share_hi", 100, False), ("share_lo", -100, False)],
    ),
)
MOST_MARKED = 60  # frames that get a mark each; more would merge into a line


def write_clip_plot(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the report of a clip, a row per frame, as a PNG of curves over its frames."""
    figure = new_figure(9.6, 7.6)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, (title, unit, curves) in zip(panels, PANELS, strict=True):
        for name, factor, thin in curves:
            _draw_channels(axes, rows, name, factor, thin)
        title_axes(axes, title)
        axes.set_ylabel(unit)
        finish([axes])
    panels[2].axhline(0, color=INK, lw=0.8)
    panels[2].yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
    panels[2].xaxis.get_major_locator().set_params(integer=True)
    panels[2].set_xlim(rows[0]["frame"] - 0.5, rows[-1]["frame"] + 0.5)
    panels[2].set_xlabel(f"frame; {_worst(rows)}")
    panels[0].legend(frameon=False, fontsize=8.5, ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
    save_figure(figure, path)


def _draw_channels(
    axes: "Axes", rows: Sequence[Mapping[str, Any]], name: str, factor: float, thin: bool
) -> None:
    style: dict[str, Any] = {"lw": 0.9, "alpha": 0.55} if thin else {"lw": 1.7}
    marker = "o" if len(rows) <= MOST_MARKED else ""
    frames = [row["frame"] for row in rows]
    for c, (label, colour, dashes) in zip("rgb", CHANNELS, strict=True):
        values = [factor * row[f"{name}_{c}"] for row in rows]
        shown = None if thin else label
        axes.plot(
            frames, values, color=colour, ls=dashes, marker=marker, ms=3, label=shown, **style
        )


def write_explained(path: Path, explained: Explained, strength: float) -> None:
    """Write the steps of compensating one frame as a sheet of labelled dome masters.

    Pictures are of the full result; titles state it if a run's `strength` is less.
    """
    full = ", at strength 1" if strength < 1 else ""
    figure = new_figure(11.2, 8.5, layout="none")  # a constrained one cuts titles off
    figure.subplots_adjust(0.01, 0.11, 0.99, 0.96, 0.04, 0.1)
    panels = figure.subplots(2, 3)
    unknown = np.isnan(explained.limits).any(axis=-1)
    unlit = np.asarray(unknown & ~explained.without.any(axis=-1))  # the others are protected
    inside = np.asarray(master_solid_angles(len(unlit)) > 0)
    shown = (explained.content, explained.without, explained.direct, explained.observed)
    white = brightest(shown, unlit)
    scattered = float(np.percentile(explained.scattered[~unlit], 99.5))
    pictures = (
        ("target", explained.content, white),
        ("without compensation", explained.without, white),
        (_scaled("scattered light in it", white, scattered), explained.scattered, scattered),
        (f"sent: direct light{full}", explained.direct, white),
        (f"with compensation, as predicted{full}", explained.observed, white),
    )
    for axes, (title, picture, top) in zip(panels.flat, pictures, strict=False):
        show_dome(axes, title, light_colours(picture, top, unlit), inside)
    _draw_limits(panels[1, 2], explained.limits, inside)
    save_figure(figure, path)


def _scaled(title: str, white: float, scattered: float) -> str:
    """The title, with the factor by which the picture is shown brighter than the others."""
    return f"{title}, shown {white / scattered:.2g} times brighter" if scattered > 0 else title


def _draw_limits(axes: "Axes", limits: FloatArray, inside: BoolArray) -> None:
    """Where a colour misses its target; too bright takes precedence over too dark."""
    codes = np.zeros(limits.shape[:2], int)
    codes[(limits < 0).any(axis=-1)] = 2
    codes[(limits > 0).any(axis=-1)] = 1
    codes[np.isnan(limits).any(axis=-1)] = 3
    show_dome(axes, "where limits hold", np.array(LIMITS)[codes] / 255, inside)
    shares = [(codes == code)[inside].mean() for code in range(len(LIMITS))]
    labels = (f"{name} ({share:.1%})" for name, share in zip(LIMIT_NAMES, shares, strict=True))
    add_legend_squares(axes, list(labels))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.01), frameon=False, fontsize=8.5)


def _worst(rows: Sequence[Mapping[str, Any]]) -> str:
    kkt, own = (max(row[name] for row in rows) for name in ("kkt", "self_consistency"))
    optimum = "no optimum is searched for" if np.isnan(kkt) else f"worst KKT residual {kkt:.1g}"
    return f"{optimum}, worst self-consistency {own:.1g}"
