"""`procam preview`: a page for the person who decides how a picture is compensated."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli._options import (
    CalibrationArgument,
    DbOption,
    Json,
    StateOption,
    TransferOption,
    WhiteNitsOption,
    WhiteOption,
)
from procam.interfaces.cli._output import Output

EXAMPLE = "procam preview my-dome sky.png"


def preview(
    calibration: CalibrationArgument,
    picture: Annotated[
        Path, typer.Argument(metavar="PICTURE", help="Dome master; of a movie its first frame.")
    ],
    out: Annotated[
        Path | None,
        typer.Argument(metavar="OUT", help="The page; by default PICTURE's name.preview.html."),
    ] = None,
    *,
    white: WhiteOption = "summed",
    transfer: TransferOption = None,
    state: StateOption = None,
    db: DbOption = None,
    white_nits: WhiteNitsOption = None,
    json: Json = False,
) -> None:
    """Write a page that shows a picture by each method beside its target, to choose by."""
    from procam.errors import InputError
    from procam.files.calibration import load_dome
    from procam.interfaces.report.preview import write_preview
    from procam.workflows.playout.explain import lit_solid_angles, views
    from procam.workflows.playout.frame import FrameSettings
    from procam.workflows.playout.sources import first_frame

    output = Output(json)
    if str(picture) == "-":
        raise InputError("PICTURE: a preview needs a file; frames from stdin have none")
    path = out or Path(f"{_name(picture)}.preview.html")
    if path.suffix != ".html":
        raise InputError(f"OUT {path}: the name must end in .html")
    settings = FrameSettings("perceptual", state, 1.0, white, transfer, db, white_nits)
    settings = settings.at(calibration)
    usual = settings.checked_method()
    assert not isinstance(usual, str)
    known, frame = load_dome(calibration), first_frame(picture)
    found = views(known, frame, settings)
    weight = lit_solid_angles(known, len(frame.rgb))
    write_preview(path, _name(picture), found, weight, usual.white_nits)
    output.say(f"{path} written; open it in a browser")
    output.finish({"page": str(path)})


def _name(picture: Path) -> str:
    """Of the page: the picture's, of numbered ones what stands before the number."""
    stem = picture.stem.split("%")[0].split("#")[0].strip("._- ")
    return stem or picture.resolve().parent.name
