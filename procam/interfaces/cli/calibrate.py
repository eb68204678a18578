"""`procam calibrate`: capture, solve and report."""

from pathlib import Path

from procam.files.calibration import calibration_in_use, load_calibration
from procam.files.lock import locked
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli import _sessions
from procam.interfaces.cli._options import Json, VenueArgument
from procam.interfaces.cli._output import Output
from procam.interfaces.report import write_report
from procam.workflows.capture.newest import capture_newest
from procam.workflows.refine.stored_pictures import keep_pictures
from procam.workflows.sample_content import half_sky
from procam.workflows.solve.calibrate import solve

EXAMPLE = "procam calibrate my-dome"


def calibrate(venue: VenueArgument, json: Json = False) -> None:
    """Capture, solve and report in one run."""
    loaded, output = load_venue(venue), Output(json)
    with locked(venue, "calibrate"):
        session = output.follow(capture_newest(loaded))["session"]
        solved = output.follow(solve(loaded, Session(session)))
        used = load_calibration(calibration_in_use(venue))
        keep_pictures(venue, used, half_sky(_sessions.CONTENT_SIZE))
        report = write_report(venue)
    written = solved["calibration"]
    output.say(f"{written} and {report} written")
    notes = output.notes(load_calibration(Path(written)), solved["compared"])
    output.finish({"calibration": written, "report": str(report), "notes": notes})
