"""Commands for what is measured apart from a visit: cameras at a desk, light with a hand meter."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli.app import CalibrationArgument, Json, app
from procam.interfaces.cli.output import Output

Photos = Annotated[
    list[Path], typer.Argument(help="Linear 16-bit TIFF or PNG, or EXR; or folders of them.")
]
Venue = Annotated[Path, typer.Option(help="Venue folder; its venue.toml has the camera's lens.")]
Camera = Annotated[str, typer.Option(help="Camera's name in venue.toml.")]


@app.command(
    epilog="Example: procam response brackets --exposures 1/64,1/32,1/16,1/8 --out zenith.csv"
)
def response(
    photos: Annotated[Path, typer.Argument(help="Folder of photographs of one still scene.")],
    *,
    out: Annotated[Path, typer.Option(help="CSV for response = in venue.toml.")],
    exposures: Annotated[
        str, typer.Option(help="Seconds, in the order of the names; else the headers tell them.")
    ] = "",
    json: Json = False,
) -> None:
    """Solve how a camera encodes light, from photographs at three exposures or more.

    A scene with all shades, tripod, fixed focus, aperture, ISO, white balance and picture profile;
    double the exposure from one photograph to the next, until most of the picture is white. Write
    1/64 and 1/128 for what the camera calls 1/60 and 1/125, if that is what it does.
    """
    from procam.interfaces.cli.desk import run_response

    run_response(photos, exposures, out, Output(json))


@app.command(
    epilog="Example: procam glare a.tif b.tif --trap 2000,1400,120 --trap 900,700,120 "
    "--venue my-dome --camera zenith --dark cap.tif --out glare.toml"
)
def glare(
    photos: Photos,
    *,
    trap: Annotated[
        list[str],
        typer.Option(help="X,Y,RADIUS of the hole's inside in pixels: one for all, or one each."),
    ],
    venue: Venue,
    camera: Camera,
    out: Annotated[Path, typer.Option(help="TOML file with the lines for venue.toml.")],
    dark: Annotated[
        Path | None, typer.Option(help="Photograph with the cap on: tells black_level too.")
    ] = None,
    trap_sigma: Annotated[
        float, typer.Option(help="Light of the trap itself, as a share of the mean around it.")
    ] = 5e-4,
    json: Json = False,
) -> None:
    """Measure the veil of glare: a light trap in the middle of something bright.

    A box lined with black velvet with a small hole, in front of a bright surround that fills the
    picture and is nowhere white. What is seen in the hole is the veil. Take three photographs or more
    with the trap at different places: what differs between them goes into glare_sigma.
    """
    from procam.interfaces.cli.desk import run_glare

    run_glare(photos, trap, (venue, camera), dark, trap_sigma, out, Output(json))


@app.command(epilog="Example: procam vignetting flat/*.tif --venue my-dome --camera zenith")
def vignetting(photos: Photos, *, venue: Venue, camera: Camera, json: Json = False) -> None:
    """Measure how a lens darkens towards the rim; prints the line for venue.toml.

    Photographs of an evenly lit white surface that fills the picture, or of the inside of an
    integrating sphere; four, with the camera turned by 90 degrees about its axis after each.
    """
    from procam.interfaces.cli.desk import run_vignetting

    run_vignetting(photos, (venue, camera), Output(json))


@app.command(
    epilog="Example: procam meter my-dome/calibrations/0001 readings.csv --out colour.json"
)
def meter(
    calibration: CalibrationArgument,
    readings: Annotated[
        Path,
        typer.Argument(
            metavar="READINGS",
            help="CSV: projector,patch,azimuth_deg,elevation_deg,Y,x,y (or X,Y,Z) in cd/m2.",
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(help="JSON file with what a unit of each channel is.")],
    json: Json = False,
) -> None:
    """Make a calibration absolute with a hand meter; exit 1 if readings and calibration disagree.

    Show red, green, blue, white and black on the whole panel of one projector, unwarped and
    unblended, the others shuttered, in the dark. Read each from the middle of the dome at one place
    well inside the picture. A second place, or a second projector of the type, checks the first.
    """
    from procam.interfaces.cli.meter import run_meter

    run_meter(calibration, readings, out, Output(json))
