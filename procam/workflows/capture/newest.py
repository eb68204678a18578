"""Selects a session of a venue: the newest, to resume and capture, or the one that was solved."""

from pathlib import Path

from procam.errors import InputError
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.versions import (
    chosen_calibration,
    list_calibrations,
    session_of,
    solved_sessions,
    venue_of_calibration,
)
from procam.workflows.capture.by_hand import PREFIX as BY_HAND
from procam.workflows.capture.capture import capture, missing_shots, prepare_session
from procam.workflows.events import Steps
from procam.workflows.venue_rig import open_rig


def capture_newest(venue: Venue) -> Steps[Session]:
    """Capture into the newest unfinished session, or a new one."""
    with recorded(venue.directory, "session capture"), open_rig(venue) as rig:
        session = prepare_session(venue, newest_session(venue))
        yield from capture(rig, venue, session)
    return session


def newest_session(venue: Venue) -> Path:
    """The newest session if it is unfinished, else the next number.

    One of a recalibration that failed is not resumed: it has photographs of another day. Neither is one
    whose photographs were deleted.
    """
    folder = venue.directory / "sessions"
    known = sorted(p for p in folder.glob("[0-9]*") if p.is_dir() and p.name.isdecimal())
    if known:
        session = Session(known[-1])
        if not (known[-1] / "plan.json").is_file():
            return known[-1]
        missing = missing_shots(session, session.read_plan(), list(venue.cameras))
        resumable = not session.is_of_recalibration and not session.is_pruned
        if missing and resumable and known[-1].name not in solved_sessions(venue.directory):
            return known[-1]
    return next_session(venue)


def next_session(venue: Venue) -> Path:
    """The folder of the session after the newest."""
    folder = venue.directory / "sessions"
    known = sorted(p for p in folder.glob("[0-9]*") if p.is_dir() and p.name.isdecimal())
    return folder / f"{int(known[-1].name) + 1 if known else 1:04d}"


def venue_of(session: Path) -> Path:
    """The venue folder of VENUE/sessions/ID."""
    folder = session.parent if session.parent.name == "sessions" else session.resolve().parent
    if folder.name != "sessions":
        raise InputError(
            f"{session}: this is no session; give a folder such as VENUE/sessions/0001"
        )
    return folder.parent


def planned_session(path: Path) -> Path:
    """A session folder; of a venue the newest one that can be solved.

    Those of recalibrations and those whose photographs were deleted are left aside.

    Raises
    ------
    InputError
        There is none, or there are both driven ones and some by hand.
    """
    if (path / "plan.json").is_file():
        return path
    known = [session for session in _planned(path) if not _is_aside(Session(session))]
    kinds = {session.name.startswith(BY_HAND) for session in known}
    if len(kinds) > 1 or not known:
        raise InputError(f"{path}: {_which(known)}; give a folder such as VENUE/sessions/0001")
    return known[-1]


def solved_session(path: Path) -> Path:
    """A session folder; that of the calibration of VENUE or VENUE@N, or a venue's only one.

    Raises
    ------
    InputError
        There is none, or several of which no calibration chooses.
    """
    if (path / "plan.json").is_file():
        return path
    venue = venue_of_calibration(path)
    known = _planned(venue)
    used = ""
    if path != venue or list_calibrations(venue):
        used = session_of(chosen_calibration(path), venue)
    found = [folder for folder in known if folder.name == used or not used]
    if used and not found:
        raise InputError(
            f"{venue}: session {used} of that calibration is gone; restore it from a backup, or give "
            "another one, such as VENUE/sessions/0001"
        )
    if len(found) != 1:
        raise InputError(f"{venue}: {_which(known)}; give a folder such as VENUE/sessions/0001")
    return found[0]


def _planned(venue: Path) -> list[Path]:
    return sorted(plan.parent for plan in venue.glob("sessions/*/plan.json"))


def _is_aside(session: Session) -> bool:
    return session.is_of_recalibration or session.is_pruned


def _which(known: list[Path]) -> str:
    names = ", ".join(folder.name for folder in known)
    return f"which of its sessions {names} is meant" if known else "there is no session here"
