"""Messages of a command that cannot go on before people have photographed."""

from pathlib import Path
from shlex import quote

from procam.errors import InputError
from procam.interfaces.cli._output import Output
from procam.workflows.photographs.open import Given
from procam.workflows.photographs.orders import PhotographsWanted


def given_photographs(photos: Path | None, replace: bool) -> Given | None:
    """What --photos and --replace say."""
    if replace and photos is None:
        raise InputError("--replace: needs --photos, the folder of photographs to take instead")
    return Given(photos, replace) if photos else None


def ask_for_photographs(
    wanted: PhotographsWanted,
    command: list[str],
    output: Output,
    place: str = "it stands where it stood for the calibration and",
) -> None:
    """Print which pictures to show and photograph, and the command that takes the photographs."""
    pictures, total = wanted.folder / "pictures", sum(row.photographs for row in wanted.rows)
    output.say(
        f"{total} photographs by camera {wanted.camera} are needed, in this order; {place} is not touched "
        "until the last round:"
    )
    for row in wanted.rows:
        shown = f"{row.picture}: {', '.join(row.projectors)}" if row.projectors else "dark"
        output.say(f"  {row.photographs:2} of {row.exposure_s:g} s  {shown}")
    if any(row.slate for row in wanted.rows):
        output.say(
            "a slate is the number of the next picture, which looks like another: show it first"
        )
    following = " ".join(map(quote, [*command, "--photos"]))
    output.say(
        f"{pictures} has a folder for each, with a picture for each projector named; the others are "
        f"dark, shuttered if they can be. The order is in {wanted.folder / 'order.csv'} too"
    )
    output.say(f"then: {following} FOLDER")
    output.finish(
        {
            "camera": wanted.camera,
            "pictures": str(pictures),
            "order": str(wanted.folder / "order.csv"),
            "wanted": [row.model_dump() for row in wanted.rows],
        }
    )
