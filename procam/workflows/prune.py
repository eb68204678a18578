"""Deletes captures that a venue does not keep, by [history] keep_sessions in venue.toml."""

from pathlib import Path

from procam.errors import InputError
from procam.files.history.record import recorded
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.versions import calibrated_session, list_calibrations, session_of

INDEX = "index.jsonl"  # stays, with the hashes of the frames


def prune_captures(venue: Venue) -> dict[str, int]:
    """Delete frames of all but the newest sessions; bytes that became free, by session.

    Sessions of calibrations in use, and of refine and state, are kept. So are plans and indexes. Those of
    recalibrations that failed are not among the newest, and are deleted whatever their number.

    Raises
    ------
    InputError
        venue.toml does not say how many to keep.
    FileFormatError
        A calibration.json is damaged, which hides the session that could be solved again.
    """
    keep = venue.table.history.keep_sessions
    if keep is None:
        raise InputError(
            f"{venue.directory / 'venue.toml'}: it does not say how many sessions to keep; add [history] "
            "with keep_sessions = 3, for the captures of the newest three and of the calibration in use"
        )
    with recorded(venue.directory, "venue prune") as run:
        known = sorted((venue.directory / "sessions").glob("[0-9][0-9][0-9][0-9]"))
        solved = {session_of(path, venue.directory) for path in list_calibrations(venue.directory)}
        failed = {p for p in known if Session(p).is_of_recalibration and p.name not in solved}
        counted = [path for path in known if path not in failed]
        needed = calibrated_session(venue.directory)
        old = [path for path in known if path not in counted[-keep:] and path.name != needed]
        freed = {path.name: _without_frames(path) for path in old}
        freed = {name: size for name, size in freed.items() if size}
        run.message = f"captures of {len(freed)} sessions deleted"
        return freed


def _without_frames(session: Path) -> int:
    size = 0
    for path in sorted((session / "captures").glob("*/*")):
        if path.is_file() and path.name != INDEX:
            size += path.stat().st_size
            path.unlink()
    return size
