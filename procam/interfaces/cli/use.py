"""`procam use`: which of a venue's calibrations counts."""

from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.calibration import list_calibrations, use_calibration
from procam.files.lock import locked
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output

EXAMPLE = "procam use my-dome 2"


def use(
    venue: VenueArgument,
    number: Annotated[int, typer.Argument(metavar="N", help="Number of the calibration.")],
    json: Json = False,
) -> None:
    """Choose which calibration of a venue counts, until a later one does.

    It is the one that refine, state, report and forecast start from, and that compensate, warp and track
    take where they are given the venue.
    """
    output, there = Output(json), {int(p.name): p for p in list_calibrations(venue)}
    if number not in there:
        names = ", ".join(str(n) for n in there) or "none"
        raise InputError(f"{venue} has no calibration {number}, only {names}; choose one of them")
    with locked(venue, "use"):
        use_calibration(venue, there[number])
    output.say(f"{there[number]} is in use")
    output.finish({"calibration": str(there[number])})
