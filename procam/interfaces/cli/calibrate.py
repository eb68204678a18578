"""`procam calibrate`: capture, solve and report."""

from procam.files.calibration import load_calibration
from procam.files.history.record import recorded
from procam.files.venue.load import load_venue
from procam.interfaces.cli import _sessions
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output, RunLog
from procam.workflows.capture.newest import capture_newest
from procam.workflows.solve.calibrate import solve

EXAMPLE = "procam calibrate my-dome"


def calibrate(venue: VenueArgument, json: Json = False) -> None:
    """Capture, solve and report in one run."""
    loaded, output = load_venue(venue), Output(json, RunLog(venue, "calibrate"))
    with recorded(venue, "calibrate"):
        session = output.follow(capture_newest(loaded))
        solved = output.follow(solve(loaded, session))
        report = _sessions.keep_report(venue)
    written = solved.directory
    output.say(f"{written} and {report} written")
    notes = output.notes(load_calibration(written), solved.compared)
    output.finish({"calibration": str(written), "report": str(report), "notes": notes})
