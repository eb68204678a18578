"""The options of `procam forecast`: a dome or a room that is planned, and its projectors."""

from pathlib import Path
from typing import Annotated

import typer

from procam.maths.mesh.rooms import BOX

Number = float | None
Lengths = tuple[float, float, float] | None
Paths = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="VENUE@N|IMAGE",
        help="First a calibrated venue, if there is one; then pictures: PNG, TIFF or EXR.",
    ),
]
Albedo = Annotated[Number, typer.Option(help="Of the paint, 0..1.")]
AlbedoSigma = Annotated[Number, typer.Option(help="Its standard error; 0.03 if not given.")]
Coverage = Annotated[Number, typer.Option(help="Share of the cap that projectors light.")]
Reflecting = Annotated[
    Number, typer.Option(help="Share of the cap that is painted, lit or not; 1 if not given.")
]
HalfAngle = Annotated[Number, typer.Option(help="From the cap's pole to its rim; 90 if not given.")]
FloorAlbedo = Annotated[Number, typer.Option(help="Of the floor; 0.1 if not given.")]
Contrast = Annotated[
    Number,
    typer.Option(help="Of the projectors, full white to full black; 2000 if not given."),
]
Radius = Annotated[Number, typer.Option(help="Of the dome; for cd/m2.")]
Lumens = Annotated[Number, typer.Option(help="Of all projectors together; for cd/m2.")]
Box = Annotated[
    Lengths,
    typer.Option(
        help="A room instead of a dome: width, depth and height in metres.", metavar="W D H"
    ),
]
Cylinder = Annotated[
    Lengths,
    typer.Option(
        help="A cylinder instead of a dome: radius in metres, arc in degrees, height in metres.",
        metavar="R ARC H",
    ),
]
Lit = Annotated[
    list[str] | None,
    typer.Option(help=f"A part of a box that projectors light: {', '.join(BOX)}. May be repeated."),
]
OtherAlbedo = Annotated[
    Number, typer.Option(help="Of a room's parts that are not lit; 0.2 if not given.")
]
Out = Annotated[Path | None, typer.Option(help="Folder for forecast.png and forecast.json.")]
