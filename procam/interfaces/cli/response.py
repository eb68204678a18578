"""`procam response`: how a camera encodes light, from bracketed photographs."""

from pathlib import Path
from typing import Annotated, Any

import typer

from procam.errors import InputError
from procam.files.images.photos import write_response
from procam.files.images.pixels import write_image
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import check_out
from procam.workflows.capture.brackets import SolvedBrackets, solve_brackets
from procam.workflows.capture.gamma_set import solve_gamma_set

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
    accept: Annotated[
        bool, typer.Option("--accept", help="Write a curve that a check refuses.")
    ] = False,
    projector: Annotated[
        bool,
        typer.Option(
            "--projector",
            help="The photographs show flat grey levels of a projector, named by them (grey_128.tif).",
        ),
    ] = False,
    levels: Annotated[
        str, typer.Option(help="With --projector: levels 0 to 255, in the order of the names.")
    ] = "",
    camera_response: Annotated[
        str, typer.Option(help="With --projector: linear, srgb or a CSV of this command.")
    ] = "linear",
    json: Json = False,
) -> None:
    """Solve how a camera encodes light, from photographs at three exposures or more.

    A scene with all shades, tripod, fixed focus, aperture, ISO, white balance and picture profile;
    double the exposure from one photograph to the next, until most of the picture is white. Write
    1/64 and 1/128 for what the camera calls 1/60 and 1/125, if that is what it does. Where something
    moved is left out, and so is one photograph that contradicts four others or more; a picture beside
    the CSV marks what does not fit. Channels that differ get curves of their own.

    With --projector, solve how a projector turns levels into light, from photographs of flat grey levels
    at one exposure, with 0 and 255 among them and white just below the camera's saturation.
    """
    output = Output(json)
    check_out(out, ".csv", replace=False)
    if projector:
        _solve_projector(output, photos, out, camera_response, levels)
        return
    seconds = [_seconds(text) for text in exposures.split(",")] if exposures else []
    solved = solve_brackets(photos, seconds, accept=accept)
    found, picture = solved.response, out.with_suffix(".png")
    if solved.picture is not None:
        check_out(picture, ".png", replace=False)
    write_response(out, found.levels, found.light)
    for note in solved.notes:
        output.say(f"warning: {note}")
    if solved.picture is not None:
        write_image(picture, solved.picture)
        output.say(f"{picture} marks in red what does not fit")
    _say_result(output, out, solved)
    output.finish(_document(out, solved))


def _solve_projector(output: Output, photos: Path, out: Path, camera: str, levels: str) -> None:
    try:
        drives = [int(text) for text in levels.split(",")] if levels else []
    except ValueError as error:
        raise InputError(
            f"--levels: {levels!r} are no whole numbers with commas between"
        ) from error
    curve = solve_gamma_set(photos, camera, drives)
    write_response(out, curve.levels, curve.values)
    output.say(
        f"{out} written: relative light of the projector; standard error {curve.sigma.max():.2%} of white at "
        "most"
    )
    document = {name: getattr(curve, name).tolist() for name in ("levels", "values", "sigma")}
    output.finish({"out": str(out), **document})


def _say_result(output: Output, out: Path, solved: SolvedBrackets) -> None:
    found = solved.response
    curves = "one curve for all channels" if found.light.ndim == 1 else "a curve for each channel"
    output.say(
        f"{len(found.exposures_s)} photographs, {curves}, residual {found.residual:.2%} of the range; "
        f"standard error of the light {found.sigma.max():.2%} of white at most"
    )
    output.say(f'{out} written; put it into the venue\'s folder and set response = "{out.name}"')


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
