"""`procam recalibrate`: only what has changed is measured anew."""

from dataclasses import asdict
from typing import Annotated

import typer

from procam.files.history.read import verify_unchanged
from procam.files.history.record import recorded
from procam.files.venue.load import load_venue
from procam.files.versions import calibration_in_use
from procam.interfaces.cli._options import Json, UnattendedOption, VenueArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.workflows.recalibrate.recalibrate import recalibrate as recalibrating
from procam.workflows.unattended import leave_for

EXAMPLE = "procam recalibrate my-dome --projector south"


def recalibrate(
    venue: VenueArgument,
    projector: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Recalibrate this projector, whatever a verification would say; may be repeated.",
        ),
    ] = None,
    unattended: UnattendedOption = False,
    json: Json = False,
) -> None:
    """Measure the projectors again that have changed, and nothing else; a new calibration.

    Verifies the venue, photographs the projectors that moved or whose light changed, and puts them into the
    calibration in use: all other projectors stay to the last bit, and seams are blended anew. The old
    calibration stays, and stays in use if the new one fits worse; exit 1 then.
    """
    loaded, output = load_venue(venue), Output(json, RunLog(venue, "recalibrate"))
    used = calibration_in_use(venue)
    with recorded(venue, "recalibrate"), leave_for(loaded, "recalibrate", unattended) as leave:
        verify_unchanged(venue, used)  # here, so that whoever is to be notified hears of it
        events = recalibrating(leave.rig, loaded, used, projector or [])
        made = output.follow(leave.watch(events))
        names = ", ".join(made.projectors)
        leave.notify("; ".join([names or "nothing to recalibrate", *made.notes]))
    written = made.calibration
    for note in made.notes:
        output.say(f"note: {note}")
    if written is None:
        output.say(f"nothing to recalibrate, {used} stays in use")
    else:
        output.say(f"{written} written: {names} measured again")
    in_use = calibration_in_use(venue)
    folders = {
        "calibration": written and str(written),
        "session": made.session and str(made.session),
    }
    output.finish({**asdict(made), **folders, "in_use": str(in_use)})
    if written is not None and in_use != written:
        raise typer.Exit(1)
