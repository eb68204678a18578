"""`procam venue canvas`: a picture of what lies where on the canvas of a room."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import check_out
from procam.model.screen import RoomScreen

EXAMPLE = "procam venue canvas my-room canvas.png"
CanvasOut = Annotated[Path, typer.Argument(metavar="OUT", help="FILE.png to write.")]
WidthOption = Annotated[
    int, typer.Option(help="Width of the content, in px, whose size is printed.", min=16, max=32766)
]


def canvas(
    venue: VenueArgument, out: CanvasOut, *, width: WidthOption = 4096, json: Json = False
) -> None:
    """Draw which part of a room lies where on the canvas that content is made for."""
    from procam.interfaces.plots.canvas import write_canvas_plot

    screen = load_venue(venue).screen
    if not isinstance(screen, RoomScreen):
        raise InputError(
            f"{venue}: the canvas of a dome is a dome master, its front at the bottom edge; this draws those "
            "of rooms"
        )
    check_out(out, ".png", option="OUT")
    write_canvas_plot(out, screen)
    rows, columns = screen.canvas.shape(width)
    width_m, height_m = screen.room.size_m
    output, layout = Output(json), screen.room.layout()
    output.say(f"{out} written: {width_m:g} x {height_m:g} m; content of {columns} x {rows} px")
    for name, (left, top, across, down) in layout.items():
        output.say(
            f"  {name:8} {left:g}..{left + across:g} m across, {top:g}..{top + down:g} m down"
        )
    document = {"out": str(out), "size_m": [width_m, height_m], "size_px": [columns, rows]}
    output.finish(document | {"parts": {name: list(box) for name, box in layout.items()}})
