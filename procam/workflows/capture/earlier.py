"""Photographs that a venue has already, which must not be given again as new ones."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from procam.errors import FileFormatError
from procam.files.session import Session
from procam.files.session_tables import StoredFrame

DATED_S = 1e8  # seconds since 1970; devices count from when they were switched on


@dataclass(frozen=True, slots=True)
class Earlier:
    """A photograph of another session or round.

    Attributes
    ----------
    session : its folder. entry : its line of the index. stored_s : when it was stored, since 1970 [s].
    """

    session: Path
    entry: StoredFrame
    stored_s: float

    @property
    def taken_s(self) -> float | None:
        """By its camera's clock, since 1970 [s]; None where it has none."""
        return self.entry.started_s if self.entry.started_s > DATED_S else None


def earlier_photographs(session: Session, camera: str) -> Iterator[Earlier]:
    """What a camera took for the other sessions beside this one; a damaged one counts as empty.

    Photographs that were pruned count too, by their line of the index.
    """
    for folder in sorted(session.directory.parent.glob("*")):
        captures = folder / "captures" / camera
        if folder == session.directory or not (captures / "index.jsonl").is_file():
            continue
        with suppress(FileFormatError):
            for entry in Session(folder).taken(camera):
                path = captures / entry.file
                dated = path if path.is_file() else captures / "index.jsonl"
                yield Earlier(folder, entry, dated.stat().st_mtime)


def notes_of_earlier(session: Session, camera: str) -> list[str]:
    """A line on photographs that another session of the venue has already."""
    earlier = {
        each.entry.sha256: each.session.name for each in earlier_photographs(session, camera)
    }
    own = session.stored(camera).values()
    again = [(e.shot, earlier[e.sha256]) for e in own if e.shot != "dark" and e.sha256 in earlier]
    if not again:
        return []
    shot, name = again[0]
    return [
        f"{len(again)} photographs, that of shot {shot} among them, are those of session {name}; if the "
        "venue was photographed anew, add the new ones with --replace"
    ]
