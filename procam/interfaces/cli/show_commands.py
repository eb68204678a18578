"""Commands for show time: what players and servers need beside the pictures."""

from pathlib import Path
from typing import Annotated

import typer

from procam.interfaces.cli.app import CalibrationArgument, Json, app
from procam.interfaces.cli.output import Output
from procam.interfaces.cli.tools import TransferOption


@app.command(epilog="Example: procam track my-dome/calibrations/0001 show/ show-track")
def track(
    calibration: CalibrationArgument,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="IN",
            help="Dome masters: a folder, a pattern such as show.####.exr, or a movie.",
        ),
    ],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder to make.")],
    *,
    method: Annotated[str, typer.Option(help="exact or subtract.")] = "exact",
    state: Annotated[
        str | None,
        typer.Option(help="House state, as `procam state` measured it; else as calibrated."),
    ] = None,
    white: Annotated[
        str, typer.Option(help="summed, or keep: the white of today's full-white frame.")
    ] = "summed",
    transfer: TransferOption = None,
    json: Json = False,
) -> None:
    """Write what a player needs to compensate a show by itself, without encoding it anew.

    A few numbers per frame, textures, and a shader that makes of them and the show's own frames what
    `procam compensate` would write. How strongly is chosen while it plays.
    """
    from procam.interfaces.cli.track import run_track
    from procam.workflows.playout.frame import FrameSettings

    how = FrameSettings(method, state, white=white, transfer=transfer)
    run_track(calibration, source, out, how, Output(json))
