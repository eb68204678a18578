"""What of a venue goes into a bundle: the keys that a solve reads, and the files that they name.

The tables are those that procam knows, as it has validated them. So comments, tables of backends (hosts,
device paths, passwords) and unknown keys never get in. Devices become "by-hand": whoever opens the
bundle has none of them. Files get numbers for names.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from procam.errors import InputError
from procam.files.session import Session
from procam.files.venue.load import Venue

ALWAYS = (
    "comments and keys of venue.toml that a solve does not read",
    "names of files, other than numbers and those of shots",
    "dates and times of day; those of photographs count from the first one",
)
PRIVATE = ("backend", "control")  # of devices
SOLVED_RESPONSE = "response.csv"  # of a camera, in its folder of a session


@dataclass(frozen=True, slots=True)
class Redacted:
    """A venue as a bundle has it.

    Attributes
    ----------
    tables : of venue.toml. files : by their names in the bundle, the files of the venue that they stand
        for. removed : lines that name what was left out.
    """

    tables: dict[str, Any]
    files: Mapping[str, Path]
    removed: tuple[str, ...]


def redact(venue: Venue, session: Session) -> Redacted:
    """The venue without what is private.

    Raises
    ------
    InputError
        venue.toml names a file outside the venue's folder.
    """
    tables = venue.table.model_dump(mode="json", exclude_unset=True)
    removed = [f"[{name}]" for name, settings in venue.backends.items() if settings]
    if tables.pop("history", None):
        removed.append("[history]")
    for kind in ("cameras", "projectors"):
        for name, device in tables[kind].items():
            removed += [f"{kind}.{name}.{key}" for key in PRIVATE if device.pop(key, None)]
    files = dict[str, Path]()
    for name, camera in tables["cameras"].items():
        _rename_response(venue, session, name, camera, files)
    for where, outlines in _outlines(tables):
        for i, outline in enumerate(outlines):
            if isinstance(outline, str):
                outlines[i] = f"masks/{len(files) + 1}.png"
                files[outlines[i]] = _inside(venue, where, outline)
    return Redacted(tables, files, (*removed, *ALWAYS))


def _rename_response(
    venue: Venue, session: Session, name: str, camera: dict[str, Any], files: dict[str, Path]
) -> None:
    """Name a table of the response; brackets are replaced by what was solved from them, if it was."""
    response = camera.get("response", "linear")
    path = None
    if camera.pop("brackets", None):
        path = session.directory / "captures" / name / SOLVED_RESPONSE
        camera["response"] = "linear"
    elif response.endswith(".csv"):
        path = _inside(venue, f"cameras.{name}.response", response)
    if path is not None and path.is_file():
        camera["response"] = f"responses/{len(files) + 1}.csv"
        files[camera["response"]] = path


def _outlines(tables: dict[str, Any]) -> Iterator[tuple[str, list[Any]]]:
    """The lists of outlines in the tables, which may name pictures, and where they are."""
    devices = [
        (f"{kind}.{n}", d) for kind in ("cameras", "projectors") for n, d in tables[kind].items()
    ]
    for where, table in (("screen", tables["screen"]), *devices):
        for key in ("masks", "protected"):
            yield f"{where}.{key}", table.get(key, [])


def _inside(venue: Venue, where: str, name: str) -> Path:
    """The file of the venue that an entry of venue.toml names."""
    path = (venue.directory / name).resolve()
    if not path.is_relative_to(venue.directory.resolve()):
        raise InputError(
            f"{venue.directory / 'venue.toml'}: {where} names {name}, which lies outside the venue's folder; "
            "copy the file into the folder and name the copy"
        )
    return path
