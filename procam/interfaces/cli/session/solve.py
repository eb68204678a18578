"""`procam session solve`: a calibration from stored captures."""

from shlex import quote

from procam.files.calibration import load_calibration
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli import _sessions
from procam.interfaces.cli._options import Json, SessionArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.model.screen import Dome
from procam.workflows.capture.newest import venue_of
from procam.workflows.solve import calibrate as solving

EXAMPLE = "procam session solve my-dome"


def solve(session: SessionArgument, json: Json = False) -> None:
    """Calibrate from stored captures alone, and report; no device is touched."""
    folder = venue_of(session)
    Session(session).read_plan()  # refuses what is no session before all else
    venue = load_venue(folder)
    output = Output(json, RunLog(venue.directory, "solve"))
    with recorded(venue.directory, "session solve"):
        solved = output.follow(solving.solve(venue, Session(session)))
        report = _sessions.keep_report(venue.directory)
    written = solved.directory
    calibration = load_calibration(written)
    output.say(f"{written} and {report} written, of session {session.name}")
    output.table(calibration.quality)
    notes = output.notes(calibration, solved.compared)
    directory = quote(str(venue.directory))
    if isinstance(calibration.screen, Dome):
        output.say(f"look at the report; then improve it by photographs: procam refine {directory}")
    output.finish({"calibration": str(written), "report": str(report), "notes": notes})
