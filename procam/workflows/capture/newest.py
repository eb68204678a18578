"""The newest session of a venue: found, resumed, captured."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from procam.errors import InputError
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.workflows.capture.capture import capture, missing_shots, prepare_session
from procam.workflows.events import Event
from procam.workflows.venue_rig import open_rig


def capture_newest(venue: Venue) -> Iterator[Event]:
    """Capture into the newest unfinished session, or a new one: its folder is `data["session"]`."""
    with recorded(venue.directory, "capture"), open_rig(venue) as rig:
        session = prepare_session(venue, newest_session(venue))
        for event in capture(rig, venue, session):
            yield replace(event, data={"session": session.directory})


def newest_session(venue: Venue) -> Path:
    """The newest session if it is unfinished, else the next number."""
    folder = venue.directory / "sessions"
    known = sorted(p for p in folder.glob("[0-9]*") if p.is_dir() and p.name.isdecimal())
    if known:
        session = Session(known[-1])
        if not (known[-1] / "plan.json").is_file():
            return known[-1]
        if missing_shots(session, session.read_plan(), list(venue.cameras)):
            return known[-1]
    return folder / f"{int(known[-1].name) + 1 if known else 1:04d}"


def venue_of(session: Path) -> Path:
    """The venue folder of VENUE/sessions/ID."""
    folder = session.parent if session.parent.name == "sessions" else session.resolve().parent
    if folder.name != "sessions":
        raise InputError(
            f"{session}: this is no session; give a folder such as VENUE/sessions/0001"
        )
    return folder.parent
