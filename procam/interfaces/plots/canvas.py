"""A picture of a room's canvas: what lies where, in metres from its upper left corner."""

from pathlib import Path

from procam.interfaces.plots.figure import finish, new_figure, save_figure
from procam.interfaces.plots.forecast import draw_layout
from procam.model.screen import RoomScreen

LONGER_IN = 10.0  # side of the figure


def write_canvas_plot(path: Path, screen: RoomScreen) -> None:
    """Write the labelled canvas of a room as PNG."""
    width_m, height_m = screen.room.size_m
    scale = LONGER_IN / max(width_m, height_m)
    figure = new_figure(max(3.0, width_m * scale), max(1.5, height_m * scale) + 0.6)
    axes = figure.subplots()
    draw_layout(axes, screen.room.layout())
    axes.set_axis_on()
    axes.set_xlabel("m from the left edge")
    axes.set_ylabel("m from the upper edge")
    finish([axes])
    save_figure(figure, path)
