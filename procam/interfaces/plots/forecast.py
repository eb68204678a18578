"""The plot of a forecast: white, contrast, and how each picture will be seen."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procam.arrays import Array
from procam.interfaces.plots.figure import (
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
from procam.workflows.forecast import Levels, checkerboard_contrast
from procam.workflows.judged_picture import Seen

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure

RELATIVE = "x direct white"
Layout = Mapping[str, tuple[float, float, float, float]]  # left, top, width and height by name [m]
DIRECT, SCATTERED, WITHOUT, WITH = "#4393c3", "#f4a582", "#ca403c", "#053061"
WIDTH, TOP, BESIDE = 10.5, 3.9, 1.2  # inches; of a row of pictures, titles and legend
TALLEST = 2.0  # height over width of a picture that is drawn in full width
SMALL_PART = 0.12  # of the canvas's longer side: parts that are narrower have no label
ROUND = [digit * 10.0**power for power in range(7) for digit in (1, 2, 5)]
WHITE_SHARES = np.geomspace(0.005, 0.95, 60)
TITLES = ("target", "without compensation", "with compensation", "limits")
LIMIT_NAMES = ("exact", "too bright", "too dark", "not lit")


def write_plot(
    path: Path,
    levels: Sequence[Levels],
    unit: str,
    pictures: Sequence[tuple[str, Seen]],
    layout: Layout | None = None,
) -> None:
    """Write a forecast as PNG.

    `levels` at the low end, the middle and the high end, with light in `unit`; `pictures` with names;
    `layout` of a room's canvas, for which contrast has no curve: it depends on where white is.
    """
    heights = [TOP, *(_height(seen) for _, seen in pictures)]
    figure = new_figure(WIDTH, sum(heights))
    figure.set_layout_engine("constrained", w_pad=0.1, h_pad=0.1)
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    left, right = parts[0].subplots(1, 2, width_ratios=(1, 1.5))
    _draw_white(left, levels, unit)
    if layout:
        draw_layout(right, layout)
    else:
        _draw_contrast(right, levels)
    for part, (name, seen) in zip(parts[1:], pictures, strict=True):
        _draw_picture(part, name, seen, layout is not None)
    save_figure(figure, path)


def _height(seen: Seen) -> float:
    """Of a picture's row [inches]."""
    rows, columns = seen.limits.shape
    return BESIDE + WIDTH / len(TITLES) * min(rows / columns, TALLEST)


def _draw_white(axes: "Axes", levels: Sequence[Levels], unit: str) -> None:
    """Full white, split into direct and scattered light."""
    low, middle, high = levels
    direct = np.array([middle.white_after, middle.white_after])
    scattered = np.array([middle.white_before - middle.white_after, 0.0])
    places = [0, 1]
    axes.bar(places, direct, 0.55, color=DIRECT, label="direct")
    axes.bar(places, scattered, 0.55, bottom=direct, color=SCATTERED, label="scattered")
    for place, name in zip(places, ("white_before", "white_after"), strict=True):
        value, ends = getattr(middle, name), [getattr(end, name) for end in (low, high)]
        if max(ends) > min(ends):
            axes.vlines(place, min(ends), max(ends), color=INK, lw=1.6)
        axes.annotate(
            f"{value:.3g}",
            (place, max(*ends, value)),
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            color=INK,
            fontsize=9.5,
        )
    axes.set_xticks(places, ["without\ncompensation", "with\ncompensation"])
    axes.set_xlim(-0.6, 1.6)
    axes.set_ylim(0, 1.42 * max(level.white_before for level in levels))
    axes.set_ylabel(f"light [{unit}]")
    title_axes(axes, "Full white", size=11)
    axes.legend(frameon=False, fontsize=8.5, loc="upper right")
    finish([axes])


def _draw_contrast(axes: "Axes", levels: Sequence[Levels]) -> None:
    """White over black in a picture of both, against the share of white."""

    def curve(level: Levels, compensated: bool) -> Array:
        black = 1 / level.on_off_before
        shares = (float(p) for p in WHITE_SHARES)
        return np.array(
            [checkerboard_contrast(level.feedback, black, p, compensated) for p in shares]
        )

    share = 100 * WHITE_SHARES
    low, middle, high = levels
    band: dict[str, Any] = {"color": WITHOUT, "alpha": 0.18, "lw": 0, "label": "95 % interval"}
    axes.fill_between(share, curve(low, False), curve(high, False), **band)
    axes.plot(
        share, curve(middle, False), color=WITHOUT, lw=4, alpha=0.6, label="without compensation"
    )
    axes.plot(share, curve(middle, True), color=WITH, lw=1.6, ls="--", label="with compensation")
    half = middle.checkerboard_before
    axes.plot([50], [half], "o", color=WITH, ms=6)
    axes.annotate(
        f"checkerboard\n{half:.3g} : 1",
        (50, half),
        xytext=(-42, -20),
        textcoords="offset points",
        ha="right",
        color=INK,
        fontsize=9.5,
        arrowprops={"arrowstyle": "-", "color": INK, "lw": 0.8},
    )
    _log_scales(axes)
    axes.set_xlabel("white share of a picture of black and white [%]")
    axes.set_ylabel("white : black")
    title_axes(axes, "Black beside white", size=11)
    axes.legend(frameon=False, fontsize=8.5, loc="upper right")
    finish([axes])


def draw_layout(axes: "Axes", layout: Layout) -> None:
    """Where the walls of a room lie on its canvas."""
    longest = max(max(left + width, top + height) for left, top, width, height in layout.values())
    for name, (left, top, width, height) in layout.items():
        right, bottom = left + width, top + height
        corners = [left, right, right, left], [top, top, bottom, bottom]
        axes.fill(*corners, facecolor="#eef3f7", edgecolor=INK, lw=0.8)
        if min(width, 2 * height) < SMALL_PART * longest:
            continue
        text = f"{name}\n{width:.3g} x {height:.3g} m"
        axes.text(left + width / 2, top + height / 2, text, ha="center", va="center", fontsize=8.5)
    axes.set_xlim(0, max(left + width for left, _, width, _ in layout.values()))
    axes.set_ylim(max(top + height for _, top, _, height in layout.values()), 0)
    axes.set_aspect("equal")
    axes.set_axis_off()
    title_axes(axes, "Canvas, as seen from inside", size=11)


def _log_scales(axes: "Axes") -> None:
    """Logarithmic axes with round numbers, and no powers of ten."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks([0.5, 1, 2, 5, 10, 20, 50, 100])
    least, most = axes.get_ylim()
    axes.set_yticks([v for v in ROUND if least <= v <= most])
    axes.minorticks_off()
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value:g}")


def _draw_picture(part: "SubFigure", name: str, seen: Seen, is_room: bool) -> None:
    panels = part.subplots(1, 4)
    part.suptitle(name, x=0.01, ha="left", fontweight="bold", fontsize=11, color=INK)
    shown = (seen.target, seen.before, seen.after)
    unlit = seen.limits == 3
    white = brightest(shown, unlit)
    inside = ~unlit if is_room else master_solid_angles(seen.limits.shape[0]) > 0
    for axes, title, picture in zip(panels, TITLES, shown, strict=False):
        show_dome(axes, title, light_colours(picture, white, unlit), inside)
    show_dome(panels[3], TITLES[3], np.array(LIMITS)[seen.limits] / 255, inside)
    add_legend_squares(panels[3], LIMIT_NAMES)
    part.legend(
        *panels[3].get_legend_handles_labels(),
        loc="outside lower right",
        ncols=4,
        frameon=False,
        fontsize=8.5,
        handletextpad=0.2,
        columnspacing=1.0,
    )
