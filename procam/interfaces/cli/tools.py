"""Commands that need no venue: calibrations, photographs and pictures are enough."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli.app import CalibrationArgument, CodeOption, Json, SizeOption, app
from procam.interfaces.cli.output import Output


@app.command(epilog="Example: procam compensate my-dome/calibrations/0001 sky.png sky-direct.exr")
def compensate(
    calibration: CalibrationArgument,
    source: Annotated[Path, typer.Argument(metavar="IN", help="Dome master: PNG, TIFF or EXR.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Where to write it.")],
    method: Annotated[
        str, typer.Option(help="exact, paper-eq12 (for comparison) or none.")
    ] = "exact",
    state: Annotated[
        str | None,
        typer.Option(help="House state, as `procam state` measured it; else as calibrated."),
    ] = None,
    json: Json = False,
) -> None:
    """Take the scattered light out of a dome master.

    1.0 (255 of 8 bits) is the calibration's reference white. Integer pictures are sRGB, EXR is
    linear. OUT is the direct light to send, also a dome master.
    """
    from procam.interfaces.cli.pictures import run_compensate

    run_compensate(calibration, (source, out), method, state, Output(json))


@app.command(epilog="Example: procam warp my-dome/calibrations/0001 sky-direct.exr frames")
def warp(
    calibration: CalibrationArgument,
    source: Annotated[Path, typer.Argument(metavar="IN", help="Picture of direct light.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for PROJECTOR.png.")],
    json: Json = False,
) -> None:
    """Make each projector's frame: warp, blend, colour, response."""
    from procam.interfaces.cli.pictures import run_warp

    run_warp(calibration, source, out, Output(json))


@app.command(epilog="Example: procam judge demo-run/calibrations/0001 demo-run/truth")
def judge(
    calibration: CalibrationArgument,
    truth: Annotated[Path, typer.Argument(help="The truth, in the same format.")],
    json: Json = False,
) -> None:
    """Compare a calibration with the truth; exit 1 if a figure misses its goal."""
    from procam.interfaces.cli.pictures import run_judge

    run_judge(calibration, truth, Output(json))


@app.command(epilog="Example: procam compare my-dome/calibrations/0001 my-dome/calibrations/0002")
def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A calibration directory.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another of the same rig.")],
    json: Json = False,
) -> None:
    """Compare two calibrations of a rig from independent captures; exit 1 if more than a turn differs.

    Another visit, another camera, or the same camera turned by 90 degrees, which shows a wrong lens
    that no residual of one visit shows. Says how far directions, areas and light are apart, whether
    their error bars cover that, and if not, whether a projector moved, a lens is doubtful, or two
    projectors are exchanged.
    """
    from procam.interfaces.cli.compare import run_compare

    run_compare(first, second, Output(json))


@app.command(epilog="Example: procam inspect my-dome/calibrations/0001")
def inspect(
    file: Annotated[Path, typer.Argument(help="Calibration, session, plan, map or picture.")],
    json: Json = False,
) -> None:
    """Say what a file or folder of procam's holds, and check that it is whole."""
    from procam.interfaces.cli.pictures import run_inspect

    run_inspect(file, Output(json))


@app.command(epilog="Example: procam decode photos --size 1024x768 --code gray --out map.exr")
def decode(
    images: Annotated[
        Path,
        typer.Argument(
            help="Folder of photographs, sorted by name as the pictures of procam patterns: white, "
            "black, waves; or for stripes, as OpenCV's, column bits (finest last) as pattern, "
            "inverse; row bits; white; black."
        ),
    ],
    size: SizeOption,
    out: Annotated[Path, typer.Option(help="EXR map: projector.x, projector.y, sigma.")],
    code: CodeOption = "gray",
    white_black: Annotated[
        float | None, typer.Option(help="Least white - black [counts]; automatic if not given.")
    ] = None,
    contrast: Annotated[
        float | None, typer.Option(help="Least |pattern - inverse| [counts]; automatic.")
    ] = None,
    json: Json = False,
) -> None:
    """Decode a folder of structured-light photographs; needs no venue."""
    from procam.interfaces.cli.decoding import run_decode

    run_decode(images, size, out, code, (white_black, contrast), Output(json))


@app.command(epilog="Example: procam camera photos --squares 10x7 --square-mm 20 --out zenith.toml")
def camera(
    images: Annotated[list[Path], typer.Argument(help="Photographs of one board, or folders.")],
    *,
    squares: Annotated[str, typer.Option(help="Squares of the board, all counted: 10x7.")],
    square_mm: Annotated[float, typer.Option(help="Edge of a square, in mm.")],
    out: Annotated[Path, typer.Option(help="TOML file with the lines for venue.toml.")],
    model: Annotated[str, typer.Option(help="brown, or kannala-brandt for fisheyes.")] = "brown",
    board: Annotated[str, typer.Option(help="checkerboard or charuco.")] = "checkerboard",
    marker_mm: Annotated[float, typer.Option(help="Charuco: edge of a marker, in mm.")] = 0.0,
    dictionary: Annotated[str, typer.Option(help="Charuco: set of markers.")] = "DICT_4X4_50",
    json: Json = False,
) -> None:
    """Solve a camera's lens from photographs of a flat board; exit 1 if it fits badly.

    Some 15 photographs, focus and zoom fixed, the board tilted to all sides and out to the corners
    of the picture. A board that is a little bent is solved along.
    """
    from procam.interfaces.cli.camera import make_board, run_camera

    made = make_board(board, squares, square_mm, marker_mm, dictionary)
    run_camera(images, made, model, out, Output(json))


@app.command(
    epilog="Example: procam pair poses --squares 10x7 --square-mm 20 --size 1280x800 --out pair.toml"
)
def pair(
    folder: Annotated[Path, typer.Argument(help="Folder with a folder of photographs per pose.")],
    *,
    squares: Annotated[str, typer.Option(help="Squares of the board, all counted: 10x7.")],
    square_mm: Annotated[float, typer.Option(help="Edge of a square, in mm.")],
    size: SizeOption,
    out: Annotated[Path, typer.Option(help="TOML file with both lenses and the pose between.")],
    code: CodeOption = "gray",
    distortion: Annotated[
        bool, typer.Option("--distortion", help="Also solve the distortion of both lenses.")
    ] = False,
    json: Json = False,
) -> None:
    """Solve a projector and a camera that look at a flat chessboard; exit 1 if it fits badly.

    Three poses of the board or more, tilted to all sides; of each the photographs of a code on it, as
    `procam decode` takes them, in a folder of its own. Needs no venue.
    """
    from procam.interfaces.cli.camera import make_board
    from procam.interfaces.cli.pair import run_pair

    board = make_board("checkerboard", squares, square_mm, 0.0, "DICT_4X4_50")
    run_pair(folder, board, (size, code), distortion, out, Output(json))


@app.command(
    epilog="Example: procam forecast --albedo 0.5 --coverage 0.9 --lumens 60000 --radius-m 8 sky.png"
)
def forecast(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="VENUE|IMAGE",
            help="First a calibrated venue, if there is one; then dome masters: PNG, TIFF or EXR.",
        ),
    ] = None,
    *,
    albedo: Annotated[float | None, typer.Option(help="Of the paint, 0..1.")] = None,
    albedo_sigma: Annotated[
        float | None, typer.Option(help="Its standard error; 0.03 if not given.")
    ] = None,
    coverage: Annotated[
        float | None, typer.Option(help="Share of the cap that projectors light.")
    ] = None,
    reflecting: Annotated[
        float | None,
        typer.Option(help="Share of the cap that is painted, lit or not; 1 if not given."),
    ] = None,
    half_angle_deg: Annotated[
        float | None, typer.Option(help="From the cap's pole to its rim; 90 if not given.")
    ] = None,
    floor_albedo: Annotated[
        float | None, typer.Option(help="Of the floor; 0.1 if not given.")
    ] = None,
    contrast: Annotated[
        float | None,
        typer.Option(help="Of the projectors, full white to full black; 2000 if not given."),
    ] = None,
    radius_m: Annotated[float | None, typer.Option(help="Of the dome; for cd/m2.")] = None,
    lumens: Annotated[
        float | None, typer.Option(help="Of all projectors together; for cd/m2.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for forecast.png and forecast.json.")
    ] = None,
    json: Json = False,
) -> None:
    """Say what white and contrast to expect, before anything is bought.

    Of a planned dome (--albedo and --coverage at least), or of a venue that is calibrated; and what
    compensation can do for your own pictures there.
    """
    from procam.interfaces.cli.forecast import run_forecast

    described = {
        "albedo": albedo,
        "albedo_sigma": albedo_sigma,
        "coverage": coverage,
        "reflecting": reflecting,
        "half_angle_deg": half_angle_deg,
        "floor_albedo": floor_albedo,
        "contrast": contrast,
        "radius_m": radius_m,
    }
    run_forecast(paths or [], described, lumens, out, Output(json))
