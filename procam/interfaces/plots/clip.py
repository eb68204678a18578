"""Pictures of a clip: its report over time, and what happens to one of its frames."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from procam.files import atomic
from procam.interfaces.plots.charts import (
    CHANNELS,
    DPI,
    INK,
    LIMITS,
    UNKNOWN,
    css_colour,
    finish,
    require_matplotlib,
)
from procam.maths.geometry.sphere import master_solid_angles
from procam.maths.light.curves import srgb_encode
from procam.workflows.playout.explain import Explained

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Colours = NDArray[np.floating]
COLOURS = "rgb"
LIMIT_NAMES = (
    "as asked for",
    "too bright: black is not dark enough",
    "too dark",
    "not lit, or protected",
)
MOST_MARKED = 60  # frames: more of them make a line of their own


def write_clip_plot(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the report of a clip, a row per frame, as a PNG of curves over its frames."""
    figure = _figure(9.6, 7.6)
    figure.set_layout_engine("constrained")
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
    _title(panels[0], "Scattered light taken out", "number s, per colour")
    draw(panels[1], "flux_in", 1, thin=True)
    draw(panels[1], "flux_out", 1)
    _title(panels[1], "Light asked for (thin) and light sent (thick)", "flux [rel sr]")
    draw(panels[2], "share_hi", 100)
    draw(panels[2], "share_lo", -100)
    panels[2].axhline(0, color=INK, lw=0.8)
    panels[2].yaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
    _title(panels[2], "Held by a limit: at full light (up), at black (down)", "lit dome [%]")
    panels[2].xaxis.get_major_locator().set_params(integer=True)
    panels[2].set_xlim(frames[0] - 0.5, frames[-1] + 0.5)
    panels[2].set_xlabel(f"frame; {_worst(rows)}")
    for axes in panels:
        finish([axes])
    panels[0].legend(frameon=False, fontsize=8.5, ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
    _save(figure, path)


def write_explained(path: Path, explained: Explained, strength: float) -> None:
    """Write what happens to one frame as a sheet of labelled dome masters.

    Pictures are of the full result; titles say so if a run's `strength` is less.
    """
    full = ", at strength 1" if strength < 1 else ""
    figure = _figure(11.2, 8.5)  # a constrained layout cuts titles off above these pictures
    figure.subplots_adjust(0.01, 0.11, 0.99, 0.96, 0.04, 0.1)
    panels = figure.subplots(2, 3)
    untold = np.isnan(explained.limits).any(axis=-1)
    unlit = np.asarray(untold & ~explained.without.any(axis=-1))  # the rest of them is protected
    inside = np.asarray(master_solid_angles(len(unlit)) > 0)
    shown = (explained.content, explained.without, explained.direct, explained.observed)
    brightest = max(1.0, *(float(np.percentile(p[~unlit], 99.5)) for p in shown))
    scattered = float(np.percentile(explained.scattered[~unlit], 99.5))
    pictures = (
        ("asked for", explained.content, brightest),
        ("seen without compensation", explained.without, brightest),
        (_scaled("scattered light in it", brightest, scattered), explained.scattered, scattered),
        (f"sent: direct light{full}", explained.direct, brightest),
        (f"seen with compensation, as predicted{full}", explained.observed, brightest),
    )
    for axes, (title, picture, white) in zip(panels.flat, pictures, strict=False):
        colours = srgb_encode(np.clip(picture / max(white, 1e-9), 0, 1))
        _show(axes, title, np.where(unlit[..., None], np.array(UNKNOWN) / 255, colours), inside)
    _draw_limits(panels[1, 2], explained.limits, inside)
    _save(figure, path)


def _scaled(title: str, brightest: float, scattered: float) -> str:
    """Say how much brighter a picture is shown than the others."""
    return f"{title}, shown {brightest / scattered:.2g} times brighter" if scattered > 0 else title


def _draw_limits(axes: "Axes", limits: Colours, inside: NDArray[np.bool_]) -> None:
    """Where a colour cannot be what it should; a colour that is too bright goes before one too dark."""
    codes = np.zeros(limits.shape[:2], int)
    codes[(limits < 0).any(axis=-1)] = 2
    codes[(limits > 0).any(axis=-1)] = 1
    codes[np.isnan(limits).any(axis=-1)] = 3
    _show(axes, "where limits hold", np.array(LIMITS)[codes] / 255, inside)
    for code, (colour, label) in enumerate(zip(LIMITS, LIMIT_NAMES, strict=True)):
        share = (codes == code)[inside].mean()
        axes.scatter(
            [],
            [],
            s=60,
            marker="s",
            color=css_colour(colour),
            edgecolors="#9aa4ad",
            label=f"{label} ({share:.1%})",
        )
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.01), frameon=False, fontsize=8.5)


def _show(axes: "Axes", title: str, colours: Colours, inside: NDArray[np.bool_]) -> None:
    """A dome master (N, N, 3) of screen values 0..1, transparent outside the circle."""
    axes.imshow(np.dstack([colours, inside]), interpolation="antialiased")
    axes.set_title(title, fontsize=10, color=INK)
    axes.set_axis_off()


def _worst(rows: Sequence[Mapping[str, Any]]) -> str:
    kkt, own = (max(row[name] for row in rows) for name in ("kkt", "self_consistency"))
    sought = "no optimum is sought" if np.isnan(kkt) else f"worst KKT residual {kkt:.1g}"
    return f"{sought}, worst self-consistency {own:.1g}"


def _title(axes: "Axes", title: str, unit: str) -> None:
    axes.set_title(title, loc="left", fontweight="bold", fontsize=10, color=INK)
    axes.set_ylabel(unit)


def _figure(width_in: float, height_in: float) -> "Figure":
    require_matplotlib()
    from matplotlib.figure import Figure  # noqa: PLC0415

    return Figure(figsize=(width_in, height_in))


def _save(figure: "Figure", path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", dpi=DPI)
    with atomic.replacing(path) as temporary:
        temporary.write_bytes(buffer.getvalue())
