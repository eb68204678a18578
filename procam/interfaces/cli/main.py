"""The `procam` command. Heavy imports wait until a command runs: `--help` stays quick."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from procam.errors import DeviceError, InputError, ProcamError
from procam.interfaces.cli.output import Output

INTERRUPTED = 130

app = typer.Typer(
    name="procam",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Calibrate a projection dome with cameras, and take the light that bounces round it out "
    "of its pictures. Start with `procam demo`.",
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of text.")]
SizeOption = Annotated[str, typer.Option(help="Projector size, such as 1280x800.")]
CodeOption = Annotated[
    str,
    typer.Option(
        help="micro-phase, micro-phase-checked, gray, gray-wide, xor-02, xor-04, phase-gray or "
        "phase-heterodyne."
    ),
]
VenueArgument = Annotated[Path, typer.Argument(help="Venue folder with a venue.toml.")]
CalibrationArgument = Annotated[
    Path, typer.Argument(help="Calibration directory, such as VENUE/calibrations/0001.")
]


@app.command(epilog="Example: procam demo --out demo-run --preset standard")
def demo(
    out: Annotated[Path, typer.Option(help="Folder to make; an earlier demo is replaced.")] = Path(
        "demo-run"
    ),
    preset: Annotated[str, typer.Option(help="ideal, standard, realistic or faulty.")] = "standard",
    json: Json = False,
) -> None:
    """Calibrate and clean a simulated dome, and judge the result against the truth."""
    from procam.interfaces.cli.demo import run_demo

    run_demo(out, preset, Output(json))


@app.command(epilog="Example: procam init my-dome --template simulated-standard")
def init(
    venue: Annotated[Path, typer.Argument(help="Folder to make.")],
    template: Annotated[
        str,
        typer.Option(
            help="Which example to start from: by-hand, simulated-faulty, simulated-ideal, "
            "simulated-realistic or simulated-standard."
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Write a complete, commented venue.toml to start from; by-hand is for rigs of your own."""
    from procam.files.venue import template_names
    from procam.interfaces.cli.venues import run_init

    if not template:
        raise InputError(
            f"--template: got none, expected one of {', '.join(template_names())}; "
            "by-hand is for rigs of your own"
        )
    run_init(venue, template, Output(json))


@app.command(epilog="Example: procam doctor my-dome")
def doctor(venue: VenueArgument, json: Json = False) -> None:
    """Check that all a venue names can be reached, exposed and resolved; exit 1 if it cannot.

    Photographs each projector about five times, says what to set, and leaves the projectors dark.
    """
    from procam.interfaces.cli.doctor import run_doctor

    run_doctor(venue, Output(json))


@app.command(epilog="Example: procam capture my-dome --dry-run")
def capture(
    venue: VenueArgument,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say how many shots, minutes and GB.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the patterns and photograph them. Killed or unplugged, it resumes where it stopped."""
    from procam.interfaces.cli.venues import run_capture

    run_capture(venue, dry_run, Output(json))


@app.command(epilog="Example: procam solve my-dome/sessions/0001")
def solve(
    session: Annotated[Path, typer.Argument(help="Session folder, such as VENUE/sessions/0001.")],
    json: Json = False,
) -> None:
    """Calibrate from stored captures alone; no device is touched."""
    from procam.interfaces.cli.venues import run_solve

    run_solve(session, Output(json))


@app.command(epilog="Example: procam calibrate my-dome")
def calibrate(venue: VenueArgument, json: Json = False) -> None:
    """Capture, solve and report, in one go."""
    from procam.interfaces.cli.venues import run_calibrate

    run_calibrate(venue, Output(json))


@app.command(epilog="Example: procam refine my-dome --picture sky.exr")
def refine(
    venue: VenueArgument,
    picture: Annotated[
        Path | None, typer.Option(help="Dome master to refine on; a half sky if none is given.")
    ] = None,
    json: Json = False,
) -> None:
    """Show the compensated picture, photograph it, correct what is left; a new calibration."""
    from procam.interfaces.cli.venues import run_refine

    run_refine(venue, picture, Output(json))


@app.command(epilog="Example: procam compensate my-dome/calibrations/0001 sky.png sky-direct.exr")
def compensate(
    calibration: CalibrationArgument,
    source: Annotated[Path, typer.Argument(metavar="IN", help="Dome master: PNG, TIFF or EXR.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Where to write it.")],
    method: Annotated[
        str, typer.Option(help="exact, paper-eq12 (for comparison) or none.")
    ] = "exact",
    json: Json = False,
) -> None:
    """Take the scattered light out of a dome master.

    1.0 (255 of 8 bits) is the calibration's reference white. Integer pictures are sRGB, EXR is
    linear. OUT is the direct light to send, also a dome master.
    """
    from procam.interfaces.cli.pictures import run_compensate

    run_compensate(calibration, source, out, method, Output(json))


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


@app.command(epilog="Example: procam report my-dome")
def report(
    where: Annotated[Path, typer.Argument(metavar="VENUE|SESSION", help="What to report on.")],
    json: Json = False,
) -> None:
    """Write report.html, one self-contained file."""
    from procam.interfaces.cli.pictures import run_report

    run_report(where, Output(json))


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


@app.command(epilog="Example: procam patterns my-dome --out pictures --movie")
def patterns(
    out: Annotated[Path, typer.Option(help="New folder for the pictures.")],
    venue: Annotated[
        Path | None, typer.Argument(help="Venue folder: all pictures of a visit, numbered.")
    ] = None,
    size: Annotated[
        str, typer.Option(help="Without a venue: projector size, such as 1280x800.")
    ] = "",
    code: CodeOption = "micro-phase",
    movie: Annotated[
        bool, typer.Option("--movie", help="With a venue: also one movie per projector.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the pictures of a venue's visit, or of one code, to be shown by any means.

    With a venue every picture carries its number, and `procam ingest` sorts the photographs.
    """
    if venue is None:
        if movie:
            raise InputError("--movie: got no VENUE, expected one: a movie shows a venue's visit")
        if not size:
            raise InputError("patterns: got no VENUE and no --size, expected one of them")
        from procam.interfaces.cli.decoding import run_patterns

        run_patterns(size, out, code, Output(json))
        return
    if size or code != "micro-phase":
        raise InputError(
            f"patterns: got --size or --code beside {venue}, expected none: venue.toml has the sizes, "
            "and a visit its code"
        )
    from procam.interfaces.cli.external import run_venue_patterns

    run_venue_patterns(venue, out, movie, Output(json))


@app.command(
    epilog="Example: procam ingest my-dome/sessions/hand-0001 --camera zenith --photos DCIM"
)
def ingest(
    session: Annotated[Path, typer.Argument(help="Session made by `procam patterns VENUE`.")],
    camera: Annotated[str, typer.Option(help="Camera's name in venue.toml.")],
    photos: Annotated[Path, typer.Option(help="Folder of linear 16-bit TIFF, PNG or JPEG.")],
    index: Annotated[
        Path | None, typer.Option(help="CSV of lines file,shot; goes before the numbers seen.")
    ] = None,
    json: Json = False,
) -> None:
    """Sort photographs taken by hand or by another program behind the shots of a session.

    They are known by the number seen in them, else by their place among the others. What is missing
    or left out is told; run it again with more photographs, it adds only what is missing.
    """
    from procam.interfaces.cli.external import run_ingest

    run_ingest(session, camera, photos, index, Output(json))


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


@app.command(epilog="Example: procam projector my-dome north shutter closed")
def projector(
    venue: VenueArgument,
    name: Annotated[str, typer.Argument(metavar="ID", help="Projector's name in venue.toml.")],
    action: Annotated[str, typer.Argument(help="state, on, off, input, shutter or hours.")],
    value: Annotated[
        str, typer.Argument(help="open or closed for shutter; a source code for input.")
    ] = "",
    json: Json = False,
) -> None:
    """Ask or tell a projector over its serial remote control."""
    from procam.interfaces.cli.venues import run_projector

    run_projector(venue, name, action, value, Output(json))


def main() -> None:
    """Entry point: errors become one clear line; 2 for bad input, 1 for a failed device or check."""
    try:
        app()
    except DeviceError as error:
        sys.exit(_complain(error, 1))
    except ProcamError as error:
        sys.exit(_complain(error, 2))
    except OSError as error:  # a full disk, a folder that may not be written
        from procam.interfaces.cli.system_errors import worded

        sys.exit(_complain(ProcamError(worded(error)), 2))
    except SystemExit as stop:
        if stop.code == INTERRUPTED:  # typer says nothing when it ends for Ctrl-C
            _complain(
                ProcamError("stopped; projectors are dark, the run can be resumed"), INTERRUPTED
            )
        raise


def _complain(error: ProcamError, code: int) -> int:
    sys.stderr.write(f"procam: {error}\n")
    return code
