"""The canvas of all plots: matplotlib without a screen, its style, and dome masters on it."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from procam.arrays import BoolArray, FloatArray
from procam.errors import InputError
from procam.files import atomic
from procam.maths.light.curves import srgb_encode

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Colour = tuple[int, int, int]
CHANNELS = (("red", "#c44e00", "-"), ("green", "#00805d", "--"), ("blue", "#0063a6", ":"))
UNKNOWN = (176, 180, 184)
# exact, too bright, too dark, not lit; the hues of the signed scale
LIMITS = ((247, 247, 247), (202, 64, 60), (50, 119, 180), UNKNOWN)
INK, GRID = "#22303c", "#d5dade"
DPI = 190
EXTRA = 'pip install "procam[report]"'


def require_matplotlib() -> Any:
    """Matplotlib, or an error with the command that installs it."""
    try:
        import matplotlib as mpl  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            f"report: matplotlib is not installed, which draws charts; run: {EXTRA}"
        ) from error
    return mpl


def css_colour(colour: Colour) -> str:
    """A colour as a web page needs it.

    >>> css_colour((255, 0, 16))
    '#ff0010'
    """
    return "#{:02x}{:02x}{:02x}".format(*colour)


def new_figure(width_in: float, height_in: float, *, layout: str = "constrained") -> "Figure":
    """An empty figure."""
    require_matplotlib()
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width_in, height_in))
    figure.set_layout_engine(layout)  # type: ignore[arg-type]
    return figure


def png_of(figure: "Figure") -> bytes:
    """The figure as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    buffer = io.BytesIO()
    FigureCanvasAgg(figure)
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def save_figure(figure: "Figure", path: Path) -> None:
    """Write the figure as PNG."""
    content = png_of(figure)
    with atomic.replacing(path) as temporary:
        temporary.write_bytes(content)


def title_axes(axes: "Axes", title: str, *, size: float = 10) -> None:
    """A title above the left end."""
    axes.set_title(title, loc="left", fontweight="bold", fontsize=size, color=INK)


def light_colours(picture: FloatArray, white: float, unlit: BoolArray) -> FloatArray:
    """Light (N, N, 3) as screen values 0..1, `white` at 1; grey where no projector reaches."""
    colours = srgb_encode(np.clip(picture / max(white, 1e-9), 0, 1))
    return np.where(unlit[..., None], np.array(UNKNOWN) / 255, colours)


def brightest(pictures: Sequence[FloatArray], unlit: BoolArray) -> float:
    """The light that pictures share as white: nearly their largest, but at least 1."""
    return max(1.0, *(float(np.percentile(p[~unlit], 99.5)) for p in pictures))


def show_dome(axes: "Axes", title: str, colours: FloatArray, inside: BoolArray) -> None:
    """A dome master (N, N, 3) of screen values 0..1, transparent outside the circle."""
    axes.imshow(np.dstack([colours, inside]), interpolation="antialiased")
    axes.set_title(title, fontsize=9.75, color=INK)
    axes.set_axis_off()


def add_legend_squares(axes: "Axes", labels: Sequence[str]) -> None:
    """Entries of the legend for the colours of limits."""
    for colour, label in zip(LIMITS, labels, strict=True):
        square = {"s": 60, "marker": "s", "color": css_colour(colour), "edgecolors": "#9aa4ad"}
        axes.scatter([], [], label=label, **square)  # type: ignore[arg-type]


def finish(panels: "Sequence[Axes]") -> None:
    """Apply the style of all plots: a light grid behind, two spines."""
    for axes in panels:
        axes.grid(color=GRID, lw=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(colors=INK, labelsize=8.5, length=3)
        axes.xaxis.label.set(color=INK, size=9)
        axes.yaxis.label.set(color=INK, size=9)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color("#9aa4ad")
