"""`procam response`: how a camera encodes light, from bracketed photographs."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.images.photos import write_response
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import check_out
from procam.workflows.capture.ingest import solve_brackets

EXAMPLE = "procam response brackets --exposures 1/64,1/32,1/16,1/8 --out zenith.csv"


def response(
    photos: Annotated[Path, typer.Argument(help="Folder of photographs of one still scene.")],
    *,
    out: Annotated[Path, typer.Option(help="CSV for response = in venue.toml.")],
    exposures: Annotated[
        str,
        typer.Option(
            help="Seconds, in the order of the names; by default from the files' headers."
        ),
    ] = "",
    json: Json = False,
) -> None:
    """Solve how a camera encodes light, from photographs at three exposures or more.

    A scene with all shades, tripod, fixed focus, aperture, ISO, white balance and picture profile;
    double the exposure from one photograph to the next, until most of the picture is white. Write
    1/64 and 1/128 for what the camera calls 1/60 and 1/125, if that is what it does.
    """
    output = Output(json)
    check_out(out, ".csv", replace=False)
    seconds = [_seconds(text) for text in exposures.split(",")] if exposures else []
    found = solve_brackets(photos, seconds)
    write_response(out, found.levels, found.light)
    worst = float(found.sigma.max())
    output.say(
        f"{len(found.exposures_s)} photographs, residual {found.residual:.2%} of the range; standard "
        f"error of the light {worst:.2%} of white at most"
    )
    output.say(f'{out} written; put it into the venue\'s folder and set response = "{out.name}"')
    output.finish(
        {
            "out": str(out),
            "residual": found.residual,
            "largest_sigma": worst,
            "exposures_s": found.exposures_s.tolist(),
            "levels": found.levels.tolist(),
            "light": found.light.tolist(),
            "sigma": found.sigma.tolist(),
        }
    )


def _seconds(text: str) -> float:
    """An exposure such as 1/60 or 0.5 [s]."""
    above, _, below = text.strip().partition("/")
    try:
        return float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError) as error:
        raise InputError(
            f"--exposures: {text.strip()!r} is no exposure; write seconds such as 1/60 or 0.5, with "
            "commas between"
        ) from error
