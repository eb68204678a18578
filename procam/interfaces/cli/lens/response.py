"""`procam lens response`: how a camera encodes light, from bracketed photographs."""

from itertools import count
from pathlib import Path
from typing import Annotated, Any

import typer

from procam.errors import InputError
from procam.files.images.photos import write_response
from procam.files.images.pixels import write_image
from procam.files.venue.edit import Key
from procam.interfaces.cli._options import CameraOption, Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli.lens._into import VenueIntoOption, check_into, give
from procam.workflows.capture.brackets import SolvedBrackets, solve_brackets

EXAMPLE = "procam lens response --photos brackets --into my-dome --camera zenith"


def response(
    *,
    photos: Annotated[Path, typer.Option(metavar="DIR", help="Photographs of one still scene.")],
    into: VenueIntoOption,
    camera: CameraOption,
    exposures: Annotated[
        str,
        typer.Option(
            help="Seconds, in the order of the names; by default from the files' headers."
        ),
    ] = "",
    accept: Annotated[
        bool, typer.Option("--accept", help="Write a curve that a check refuses.")
    ] = False,
    json: Json = False,
) -> None:
    """Solve how a camera encodes light, from photographs at three exposures or more.

    A scene with all shades, tripod, fixed focus, aperture, ISO, white balance and picture profile;
    double the exposure from one photograph to the next, until most of the picture is white. Write
    1/64 and 1/128 for what the camera calls 1/60 and 1/125, if that is what it does. Where something
    moved is left out, and so is one photograph that contradicts four others or more; a picture beside
    the curve marks what does not fit. Channels that differ get curves of their own.
    """
    output = Output(json)
    check_into(into, camera)
    seconds = [_seconds(text) for text in exposures.split(",")] if exposures else []
    solved = solve_brackets(photos, seconds, accept=accept)
    found, out = solved.response, _new_curve(into, camera)
    picture = out.with_suffix(".png")
    write_response(out, found.levels, found.light)
    for note in solved.notes:
        output.say(f"warning: {note}")
    if solved.picture is not None:
        write_image(picture, solved.picture)
        output.say(f"{picture} marks in red what does not fit")
    _say_result(output, out, solved)
    try:
        give(into, camera, [Key("response", out.name)], output)
    except InputError:
        out.unlink()  # venue.toml says that the response comes from elsewhere
        raise
    output.finish(_document(out, solved))


def _new_curve(venue: Path, camera: str) -> Path:
    """A file in the venue's folder for a curve that overwrites none."""
    names = (f"{camera}-response{f'-{n}' * (n > 1)}.csv" for n in count(1))
    return next(path for name in names if not (path := venue / name).exists())


def _say_result(output: Output, out: Path, solved: SolvedBrackets) -> None:
    found = solved.response
    curves = "one curve for all channels" if found.light.ndim == 1 else "a curve for each channel"
    output.say(
        f"{len(found.exposures_s)} photographs, {curves}, residual {found.residual:.2%} of the range; "
        f"standard error of the light {found.sigma.max():.2%} of white at most"
    )
    output.say(f"{out} written")


def _document(out: Path, solved: SolvedBrackets) -> dict[str, Any]:
    found = solved.response
    return {
        "out": str(out),
        "residual": found.residual,
        "largest_sigma": float(found.sigma.max()),
        "exposures_s": found.exposures_s.tolist(),
        "photographs": solved.names,
        "left_out": solved.left_out,
        "overruled": found.overruled,
        "moved_share": found.moved_share,
        "warnings": solved.notes,
        "picture": str(out.with_suffix(".png")) if solved.picture is not None else None,
        "levels": found.levels.tolist(),
        "light": found.light.tolist(),
        "sigma": found.sigma.tolist(),
    }


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
