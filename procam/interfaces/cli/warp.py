"""`procam warp`: the frames of each projector."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli._frames import report_frames
from procam.interfaces.cli._options import CalibrationArgument, Json, TransferOption
from procam.interfaces.cli._output import Output
from procam.workflows.playout.warp import warp_file

EXAMPLE = "procam warp my-dome/calibrations/0001 direct.exr frames"


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

    A picture becomes OUT/PROJECTOR.png, numbered pictures become OUT/PROJECTOR/NAME.png, and a movie
    becomes OUT/PROJECTOR.mov, or .mkv if it was one.
    """
    report_frames(warp_file(calibration, source, out, transfer), source, Output(json))
