"""Pictures of a clip: its report over time, and the steps of compensating one frame."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procam.interfaces.plots.figure import (
    CHANNELS,
    INK,
    LIMITS,
    UNKNOWN,
    add_legend_squares,
    finish,
    new_figure,
    save_figure,
    show_dome,
    title_axes,
)
from procam.maths.geometry.sphere import master_solid_angles
from procam.maths.light.curves import srgb_encode
from procam.workflows.playout.explain import Explained

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Colours = NDArray[np.floating]
COLOURS = "rgb"
LIMIT_NAMES = (
    "exact",
    "too bright: black is not dark enough",
    "too dark",
    "not lit, or protected",
)
MOST_MARKED = 60  # frames that get a mark each; more would merge into a line


def write_clip_plot(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the report of a clip, a row per frame, as a PNG of curves over its frames."""
    figure = new_figure(9.6, 7.6)
    panels = figure.subplots(3, 1, sharex=True)
    frames = np.array([row["frame"] for row in rows])

    def draw(axes: "Axes", name: str, factor: float, thin: bool = False) -> None:
        for c, (label, colour, style) in zip(COLOURS, CHANNELS, strict=True):
            values = factor * np.array([row[f"{name}_{c}"] for row in rows])
            axes.plot(
                frames,
                values,
                color=colour,
                ls=style,
                lw=0.9 if thin else 1.7,
                marker="o" if len(rows) <= MOST_MARKED else "",
                ms=3,
                alpha=0.55 if thin else 1,
                label=None if thin else label,
            )

    draw(panels[0], "s", 1)
    _title(panels[0], "Scattered light removed", "scatter level s, per colour")
    draw(panels[1], "flux_in", 1, thin=True)
    draw(panels[1], "flux_out", 1)
    _title(panels[1], "Light asked for (thin) and light sent (thick)", "flux [rel sr]")
    draw(panels[2], "share_hi", 100)
    draw(panels[2], "share_lo", -100)
    panels[2].axhline(0, color=INK, lw=0.8)
    panels[2].yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
    _title(panels[2], "At a limit: at full light (up), at black (down)", "lit dome [%]")
    panels[2].xaxis.get_major_locator().set_params(integer=True)
    panels[2].set_xlim(frames[0] - 0.5, frames[-1] + 0.5)
    panels[2].set_xlabel(f"frame; {_worst(rows)}")
    for axes in panels:
        finish([axes])
    panels[0].legend(frameon=False, fontsize=8.5, ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
    save_figure(figure, path)


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
    brightest = max(1.0, *(float(np.percentile(p[~unlit], 99.5)) for p in shown))
    scattered = float(np.percentile(explained.scattered[~unlit], 99.5))
    pictures = (
        ("target", explained.content, brightest),
        ("without compensation", explained.without, brightest),
        (_scaled("scattered light in it", brightest, scattered), explained.scattered, scattered),
        (f"sent: direct light{full}", explained.direct, brightest),
        (f"with compensation, as predicted{full}", explained.observed, brightest),
    )
    for axes, (title, picture, white) in zip(panels.flat, pictures, strict=False):
        colours = srgb_encode(np.clip(picture / max(white, 1e-9), 0, 1))
        show_dome(axes, title, np.where(unlit[..., None], np.array(UNKNOWN) / 255, colours), inside)
    _draw_limits(panels[1, 2], explained.limits, inside)
    save_figure(figure, path)


def _scaled(title: str, brightest: float, scattered: float) -> str:
    """The title, with the factor by which the picture is shown brighter than the others."""
    return f"{title}, shown {brightest / scattered:.2g} times brighter" if scattered > 0 else title


def _draw_limits(axes: "Axes", limits: Colours, inside: NDArray[np.bool_]) -> None:
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
    sought = "no optimum is searched for" if np.isnan(kkt) else f"worst KKT residual {kkt:.1g}"
    return f"{sought}, worst self-consistency {own:.1g}"


def _title(axes: "Axes", title: str, unit: str) -> None:
    title_axes(axes, title)
    axes.set_ylabel(unit)
