"""Options and arguments that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.versions import chosen_calibration

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of text.")]


def _without_number(path: Path) -> Path:
    if "@" in path.name and not path.exists():
        raise InputError(
            f"{path}: this command takes no calibration, but a venue; leave out @ and what follows"
        )
    return path


def _session_of(path: Path) -> Path:
    from procam.workflows.capture.newest import planned_session

    return planned_session(path)


VenueArgument = Annotated[
    Path,
    typer.Argument(
        metavar="VENUE", help="Venue folder with a venue.toml.", callback=_without_number
    ),
]
SessionArgument = Annotated[
    Path,
    typer.Argument(
        metavar="VENUE|SESSION",
        help="Venue folder, for its newest session; or one such as VENUE/sessions/0001.",
        callback=_session_of,
    ),
]
SUBJECT = (
    "Venue, for its calibration in use; VENUE@3 for its calibration 3; or a calibration's folder."
)


CalibrationArgument = Annotated[
    Path, typer.Argument(metavar="VENUE@N", help=SUBJECT, callback=chosen_calibration)
]
FromArgument = Annotated[Path, typer.Argument(metavar="VENUE@N", help=SUBJECT)]
RoundPhotos = Annotated[
    Path | None,
    typer.Option(help="By hand: folder with the photographs that the run before asked for."),
]
ReplaceRound = Annotated[
    bool,
    typer.Option(
        "--replace", help="With --photos: they replace the last ones that were given, not the next."
    ),
]

UnattendedOption = Annotated[
    bool,
    typer.Option(
        "--unattended",
        help="For schedulers: light projectors only at the time that venue.toml states, and only if "
        "its interlock command says that nobody is in the dome.",
    ),
]

DbOption = Annotated[
    float | None,
    typer.Option(
        help="Perceptual methods: loss in dB, against exact, that is allowed for better contrast."
        "  [default: 0]"
    ),
]
WhiteNitsOption = Annotated[
    float | None,
    typer.Option(help="Perceptual methods: luminance of white, in cd/m2.  [default: 14]"),
]

# structured light and boards
SizeOption = Annotated[str, typer.Option(help="Projector size, such as 1280x800.")]
CodeOption = Annotated[
    str,
    typer.Option(
        help="micro-phase, gray or phase-heterodyne; or a TOML file that describes another code."
    ),
]
OrderOption = Annotated[
    str,
    typer.Option(
        help="Order of the pictures: white, black, columns, rows, or parts of them such as "
        "columns-gray, columns-inverses, rows-phase; with commas between."
    ),
]
SquaresOption = Annotated[str, typer.Option(help="Squares of the board, all counted: 10x7.")]
SquareOption = Annotated[float, typer.Option(help="Edge of a square, in mm.")]

CameraOption = Annotated[str, typer.Option(help="Camera's name in venue.toml.")]

# frames of a show
TransferOption = Annotated[
    str | None,
    typer.Option(
        help="How IN encodes light: srgb, linear, gamma2.2, gamma2.4, gamma2.6 or bt1886. By "
        "default, what the file declares: sRGB for integer pictures, linear for EXR."
    ),
]
WhiteOption = Annotated[
    str,
    typer.Option(
        help="Luminance of content value 1.0: summed, the white that every place can reach, or keep, "
        "today's full white."
    ),
]
StateOption = Annotated[
    str | None,
    typer.Option(help="Venue state, as measured by `procam state`; by default as calibrated."),
]
