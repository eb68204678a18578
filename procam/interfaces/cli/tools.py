"""Commands that need no venue: calibrations, photographs and pictures are enough."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli.app import CalibrationArgument, CodeOption, Json, SizeOption, app
from procam.interfaces.cli.output import Output

TransferOption = Annotated[
    str | None,
    typer.Option(
        help="How IN encodes light: srgb, linear, gamma2.2, gamma2.4, gamma2.6 or bt1886. If not "
        "given, what IN says: sRGB for integer pictures, linear for EXR."
    ),
]


@app.command(epilog="Example: procam compensate my-dome/calibrations/0001 sky.%04d.exr direct")
def compensate(
    calibration: CalibrationArgument,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help="Dome masters: a PNG, TIFF or EXR; numbered ones as sky.%04d.exr, sky.####.exr or a "
            "folder; a movie; or - for bare frames from stdin.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="A picture; a pattern or a folder; a .mov (ProRes 4444) or .mkv (FFV1, lossless); or "
            "- for stdout.",
        ),
    ],
    *,
    method: Annotated[
        str,
        typer.Option(help="exact, subtract, least-squares, paper-eq12 (for comparison) or none."),
    ] = "exact",
    strength: Annotated[
        float, typer.Option(help="From 0, the content as it is, to 1, all of the correction.")
    ] = 1.0,
    white: Annotated[
        str,
        typer.Option(
            help="What content 1.0 is: summed, the white that all of the dome can reach, or keep, "
            "today's full white."
        ),
    ] = "summed",
    transfer: TransferOption = None,
    state: Annotated[
        str | None,
        typer.Option(help="House state, as `procam state` measured it; else as calibrated."),
    ] = None,
    explain: Annotated[
        Path | None, typer.Option(help="Folder for pictures of what happens to the first frame.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="FILE.csv with a line per frame; FILE.png is a plot of it."),
    ] = None,
    size: Annotated[int, typer.Option(help="With -: edge of the frames, in px.")] = 0,
    pixels: Annotated[str, typer.Option(help="With -: rgb24, rgb48le, rgbf16le or rgbf32le.")] = "",
    json: Json = False,
) -> None:
    """Take the scattered light out of dome masters.

    1.0 (255 of 8 bits) is the calibration's reference white. OUT is the direct light to send, also
    dome masters; depth, alpha, attributes, numbers, timestamps and sound are kept. A run that was
    killed is resumed. On a pipe each frame is sent at once, and stderr tells the latency at the end.
    """
    from procam.interfaces.cli.frames import run_compensate
    from procam.workflows.playout.frame import FrameSettings

    how = FrameSettings(method, state, strength, white, transfer)
    run_compensate(calibration, (source, out), how, (explain, report), (size, pixels), Output(json))


@app.command(epilog="Example: procam warp my-dome/calibrations/0001 direct.exr frames")
def warp(
    calibration: CalibrationArgument,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN", help="Direct light: a picture, a folder, a pattern or a movie."
        ),
    ],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Folder for what each projector is sent.")
    ],
    transfer: TransferOption = None,
    json: Json = False,
) -> None:
    """Make each projector's frames: warp, blend, colour, response.

    OUT/PROJECTOR.png of a picture, OUT/PROJECTOR/NAME.png of numbered ones, OUT/PROJECTOR.mov (.mkv
    of .mkv) of a movie.
    """
    from procam.interfaces.cli.frames import run_warp

    run_warp(calibration, source, out, transfer, Output(json))


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
