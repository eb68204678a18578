"""`procam session undo`: photographs of a session set aside, to add others."""

from shlex import quote

from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli._options import CameraOption, Json, SessionArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.workflows.capture import ingest
from procam.workflows.capture.newest import venue_of

EXAMPLE = "procam session undo my-dome --camera zenith"


def undo(session: SessionArgument, camera: CameraOption, json: Json = False) -> None:
    """Set all photographs of a camera aside, to begin again."""
    stored, venue = Session(session), load_venue(venue_of(session))
    output = Output(json, RunLog(venue.directory, "undo"))
    stored.read_plan()  # refuses what is no session before a lock file is made in it
    aside = ingest.undo(venue, stored, camera)
    output.say(
        f"photographs by camera {camera} are in {aside} now; add others: procam session add "
        f"{quote(str(session))} --camera {camera} --photos FOLDER"
    )
    output.finish({"set_aside": str(aside)})
