"""Data sets of simulated domes: sessions as bundles, each with the truth about its room.

DATASET/dataset.json  bundles/NAME.zip  truth/ROOM/calibration.json + maps (the calibration-directory format)

`python -m studies.dataset` makes one.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from procam.errors import FileFormatError
from procam.files.bundle.manifest import FileEntry
from procam.files.bundle.names import SESSION
from procam.files.bundle.read import open_bundle
from procam.files.calibration import load_calibration
from procam.files.history.store import file_digest
from procam.files.session import Session
from procam.files.session_tables import checked, parse_object
from procam.files.venue.load import Venue, load_venue
from procam.files.venue.tables import Name
from procam.model.calibration import Calibration

SCHEMA, INDEX = 1, "dataset.json"
_PART = r"[A-Za-z0-9][A-Za-z0-9_.-]*"
FilePath = Annotated[str, StringConstraints(pattern=rf"^{_PART}(/{_PART})*$")]


class SessionEntry(BaseModel):
    """A session of dataset.json: its name, the room it shows, and the seed of its noise."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: Name
    room: Name
    seed: Annotated[int, Field(ge=0)]

    @property
    def bundle(self) -> str:
        """The session's file."""
        return f"bundles/{self.name}.zip"

    @property
    def truth(self) -> str:
        """The folder of the truth about its room."""
        return f"truth/{self.room}"


class DatasetIndex(BaseModel):
    """dataset.json: sessions, and the size and sha256 of every other file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_version: int
    procam: str
    license: str
    command: str
    sessions: list[SessionEntry]
    files: dict[FilePath, FileEntry]


@dataclass(frozen=True, slots=True)
class DatasetSession:
    """A session of a data set, ready to be read or solved.

    Attributes
    ----------
    name, room, seed : which one it is; sessions of a room differ in their noise alone.
    venue : what its owner knows of the rig. session : plan, patterns and photographs.
    truth_dir : the truth about the room, in the calibration-directory format.
    """

    name: str
    room: str
    seed: int
    venue: Venue
    session: Session
    truth_dir: Path

    @property
    def truth(self) -> Calibration:
        """The truth, with sigmas of zero."""
        return load_calibration(self.truth_dir)


def load_dataset(directory: str | Path, work: str | Path) -> Iterator[DatasetSession]:
    """The sessions of a data set with the truth about each, after all files are checked by their sha256.

    Parameters
    ----------
    directory : folder with a dataset.json.
    work : folder in which each session gets a venue folder; those that are there already are used.

    Returns
    -------
    sessions : in the order of dataset.json, each unpacked when it is asked for.

    Raises
    ------
    FileFormatError
        A file is missing, changed, or of a later version.

    Examples
    --------
    >>> for each in load_dataset(Path("no-such-folder"), Path("work")):
    ...     print(each.name, each.truth.feedback.value)
    Traceback (most recent call last):
    procam.errors.FileFormatError: ...
    """
    directory, work = Path(directory), Path(work)
    index = _checked_index(directory)
    return (_opened(directory, work, entry) for entry in index.sessions)


def _opened(directory: Path, work: Path, entry: SessionEntry) -> DatasetSession:
    folder = work / entry.name
    if not folder.exists():
        work.mkdir(parents=True, exist_ok=True)
        open_bundle(directory / entry.bundle, folder)
    session, truth = Session(folder / SESSION), directory / entry.truth
    return DatasetSession(entry.name, entry.room, entry.seed, load_venue(folder), session, truth)


def _checked_index(directory: Path) -> DatasetIndex:
    """dataset.json, whose files are all there and as they were."""
    path = directory / INDEX
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file; give the folder of a data set of procam's")
    document = parse_object(path, path.read_bytes())
    if document.get("schema_version") != SCHEMA:
        raise FileFormatError(
            f"{path} has schema_version {document.get('schema_version')!r}, and this version of procam reads "
            f"{SCHEMA}; use the version that wrote it"
        )
    index = checked(DatasetIndex, document, path, "get it again")
    needed = [f for s in index.sessions for f in (s.bundle, f"{s.truth}/calibration.json")]
    for name in dict.fromkeys([*needed, *_read_with(directory, index), *index.files]):
        _check_file(directory / name, index.files.get(name))
    return index


def _read_with(directory: Path, index: DatasetIndex) -> Iterator[str]:
    """All files in the folders of truth, which are read with calibration.json."""
    for folder in dict.fromkeys(directory / session.truth for session in index.sessions):
        for path in sorted(folder.rglob("*")):
            if not path.is_dir():
                yield path.relative_to(directory).as_posix()


def _check_file(file: Path, entry: FileEntry | None) -> None:
    """Refuse a file that is not as its entry says, or has none."""
    if not file.is_file():
        raise FileFormatError(f"{file}: missing from the data set; get it again")
    if entry is None:
        raise FileFormatError(
            f"{file} is not listed in {INDEX}; remove it, or get the data set again"
        )
    if file.stat().st_size != entry.bytes or file_digest(file) != entry.sha256:
        raise FileFormatError(f"{file} has changed since the data set was made; get it again")
