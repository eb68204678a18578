"""`procam export`: what another program needs to show a calibrated venue."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.interfaces.cli._options import (
    CalibrationArgument,
    Json,
    StateOption,
    TransferOption,
    WhiteOption,
)
from procam.interfaces.cli._output import Output
from procam.workflows.playout.frame import FrameSettings
from procam.workflows.playout.track import track_show

EXAMPLE = "procam export my-dome shader show show-track"
CONSUMERS = ("shader",)


def export(
    calibration: CalibrationArgument,
    consumer: Annotated[
        str, typer.Argument(metavar="CONSUMER", help="shader: a player that compensates by itself.")
    ],
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
    state: StateOption = None,
    white: WhiteOption = "summed",
    transfer: TransferOption = None,
    json: Json = False,
) -> None:
    """Write what another program needs to show a calibrated venue.

    For a shader: what a player needs to compensate a show by itself, without encoding it anew. A few
    coefficients per frame, textures, and a shader that computes from them and the show's own frames what
    `procam compensate` would write. The strength is chosen while the show plays.
    """
    if consumer not in CONSUMERS:
        raise InputError(f"CONSUMER: {consumer!r} is unknown; choose {' or '.join(CONSUMERS)}")
    output = Output(json)
    settings = FrameSettings(method, state, white=white, transfer=transfer)
    track = output.follow(track_show(calibration, source, out, settings))
    output.warn(track.notes)
    document = {"out": str(out), "notes": track.notes} | track.document
    output.say(
        f"{out} written: {document['frames']['count']} frames of {document['size']} px, "
        f"{len(document['numbers']['columns'])} coefficients each; give the folder to the player, whose "
        "programmer finds the format in README.txt"
    )
    output.finish(document)
