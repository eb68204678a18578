"""`procam venue use`: another calibration of a venue put in use."""

from pathlib import Path
from typing import Annotated

import typer

from procam.errors import InputError
from procam.files.history.read import verify_unchanged
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.versions import (
    calibrated_session,
    chosen_calibration,
    list_calibrations,
    use_calibration,
    venue_of_calibration,
)
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output

EXAMPLE = "procam venue use my-dome@3"


def use(
    start: Annotated[Path, typer.Argument(metavar="VENUE@N", help="The calibration to use.")],
    json: Json = False,
) -> None:
    """Use calibration N of a venue until a later one is made.

    Calibrations are never overwritten. The one in use is what all commands take where they are given the
    venue alone, and what refine, state and verify start from.
    """
    venue, chosen = venue_of_calibration(start), chosen_calibration(start)
    if venue == start:
        there = ", ".join(f"{venue}@{int(path.name)}" for path in list_calibrations(venue))
        raise InputError(f"{start}: which of its calibrations? Choose from {there or 'none'}")
    output = Output(json)
    verify_unchanged(venue, chosen)
    with recorded(venue, "venue use") as run:
        use_calibration(venue, chosen)
        run.message = f"back to {chosen.name}"
    output.say(f"{chosen} is in use")
    session = Session(venue / "sessions" / calibrated_session(venue))
    gone = session.is_pruned or not (session.directory / "captures").is_dir()
    notes = [_no_photographs(session)] if gone else []
    output.warn(notes)
    output.finish({"calibration": str(chosen), "notes": notes})


def _no_photographs(session: Session) -> str:
    return (
        f"the photographs of its session {session.directory.name} are gone: verify, recalibrate and "
        "solve cannot use it. Restore them from a backup, or calibrate again"
    )
