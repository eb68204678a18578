"""What the commands share that capture, solve and refine a venue."""

from pathlib import Path

from procam.errors import InputError
from procam.files import atomic
from procam.files.calibration import next_directory, save_calibration
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.interfaces.cli._output import Output
from procam.workflows.capture import capture as capturing
from procam.workflows.refine.refine import Refined
from procam.workflows.venue_rig import open_rig

CONTENT_SIZE = 1024  # edge of the sample picture [px]


def take(venue: Venue, output: Output) -> Session:
    """Capture into the newest unfinished session, or a new one."""
    with atomic.locked(venue.directory / "sessions"), open_rig(venue) as rig:
        session = capturing.prepare_session(venue, open_session(venue))
        output.follow(capturing.capture(rig, venue, session))
    return session


def open_session(venue: Venue) -> Path:
    """The newest session if it is unfinished, else the next number."""
    folder = venue.directory / "sessions"
    known = sorted(p for p in folder.glob("[0-9]*") if p.is_dir())
    if known:
        session = Session(known[-1])
        if not (known[-1] / "plan.json").is_file():
            return known[-1]
        if capturing.missing_shots(session, session.read_plan(), list(venue.cameras)):
            return known[-1]
    return folder / f"{len(known) + 1:04d}"


def venue_of(session: Path) -> Path:
    """The venue folder of VENUE/sessions/ID."""
    folder = session.resolve().parent
    if folder.name != "sessions":
        raise InputError(
            f"{session}: this is no session; give a folder such as VENUE/sessions/0001"
        )
    return folder.parent


def keep_refined(directory: Path, kept: Path, refined: Refined, output: Output) -> Path:
    """Write the loop's calibration if it is better than the one at `kept`; returns the newest one."""
    if refined.worse:
        output.say(f"nothing written, {kept} stays newest: {refined.worse}")
        return kept
    if not refined.corrections:
        output.say(f"nothing to correct, {kept} stays newest")
        return kept
    out = next_directory(directory)
    save_calibration(refined.calibration, out)
    output.say(f"{out} written")
    return out
