"""`procam solve`: a calibration from stored captures."""

from pathlib import Path
from typing import Annotated

import typer

from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output
from procam.workflows.capture.newest import venue_of
from procam.workflows.solve import calibrate as solving

EXAMPLE = "procam solve my-dome/sessions/0001"


def solve(
    session: Annotated[Path, typer.Argument(help="Session folder, such as VENUE/sessions/0001.")],
    json: Json = False,
) -> None:
    """Calibrate from stored captures alone; no device is touched."""
    venue, output = load_venue(venue_of(session)), Output(json)
    solved = output.follow(solving.solve(venue, Session(session)))
    written = solved["calibration"]
    calibration = load_calibration(Path(written))
    output.say(f"{written} written")
    output.table(calibration.quality)
    notes = output.notes(calibration, solved["compared"])
    output.finish({"calibration": written, "notes": notes})
