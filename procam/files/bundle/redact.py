"""Selects the parts of a venue and its plan for a bundle: keys that a solve reads, and files that they name.

`procam.files.venue.sharing` lists the keys. So commands, tables of backends (hosts, device paths,
passwords), comments and unknown keys never get in. Devices become "by-hand": whoever opens the bundle has
none of them. Files and marks get numbers for names.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

from procam.errors import InputError
from procam.files.obj import shared_parts
from procam.files.session import Session
from procam.files.venue.load import Venue
from procam.files.venue.sharing import shared_tables
from procam.files.venue.tables import MeshTable
from procam.model.plan import Plan

MESH = "meshes/1.obj"
BACKENDS = "tables of backends"
ALWAYS = (
    "comments and keys of venue.toml that a solve does not read",
    "names of marks, other than numbers",
    "names of files, other than numbers and those of shots",
    "dates and times of day; those of photographs count from the first one",
)
SOLVED_RESPONSE = "response.csv"  # of a camera, in its folder of a session
# of a shot's pattern
DETAILS = ("code", "plane", "axis", "bit", "inverse", "zone", "channel", "picture", "number")


@dataclass(frozen=True, slots=True)
class Redacted:
    """A venue as a bundle has it.

    Attributes
    ----------
    tables : of venue.toml. files : by their names in the bundle, the files of the venue that they stand
        for. removed : the dotted paths of keys that were left out, and `BACKENDS` if they have tables.
    """

    tables: dict[str, Any]
    files: Mapping[str, Path]
    removed: tuple[str, ...]


def redact(venue: Venue, session: Session) -> Redacted:
    """The venue without what is private. Applied to its own result it changes nothing.

    Raises
    ------
    InputError
        venue.toml names a file outside the venue's folder.
    """
    tables, removed = shared_tables(venue.table)
    if any(venue.backends.values()):
        removed.append(BACKENDS)
    _number_marks(venue, tables)
    files = dict[str, Path]()
    for name, camera in tables["cameras"].items():
        _rename_response(venue, session, name, camera, files)
    if isinstance(venue.table.screen, MeshTable):
        files[MESH] = _inside(venue, "screen.file", venue.table.screen.file)
        _rename_parts(tables["screen"], shared_parts(files[MESH]))
    for where, outlines in _outlines(tables):
        for i, outline in enumerate(outlines):
            if isinstance(outline, str):
                outlines[i] = f"masks/{len(files) + 1}.png"
                files[outlines[i]] = _inside(venue, where, outline)
    return Redacted(tables, files, tuple(removed))


def shared_plan(plan: Plan) -> Plan:
    """The plan with what procam notes about patterns, and nothing else."""
    shots = (
        replace(shot, detail={key: shot.detail[key] for key in DETAILS if key in shot.detail})
        for shot in plan.shots
    )
    return Plan(tuple(shots))


def _number_marks(venue: Venue, tables: dict[str, Any]) -> None:
    """Name marks by numbers, but those that are AprilTags; their names can be any text."""
    tags = {tag.name for tag in venue.tags}
    taken = {*tags, *tables["cameras"], *tables["projectors"]}
    fresh = (name for i in count(1) if (name := f"mark-{i}") not in taken)
    marks = tables.get("fiducials", [])
    names = dict.fromkeys(mark["name"] for mark in marks if mark["name"] not in tags)
    numbered = dict(zip(names, fresh, strict=False))
    entries = [(mark, "name") for mark in marks]
    entries += [(distance, end) for distance in tables.get("distances", []) for end in ("a", "b")]
    for entry, key in entries:
        entry[key] = numbered.get(entry[key], entry[key])


def _rename_parts(screen: dict[str, Any], names: Mapping[str, str]) -> None:
    """Name the mesh's file and its parts as a bundle does."""
    screen["file"] = MESH
    screen["lit"] = [names[name] for name in screen["lit"]]
    if "others" in screen:
        screen["others"] = {names[name]: given for name, given in screen["others"].items()}


def _rename_response(
    venue: Venue, session: Session, name: str, camera: dict[str, Any], files: dict[str, Path]
) -> None:
    """Name a table of the response; brackets are replaced by what was solved from them, if it was."""
    response = camera.get("response", "linear")
    path = None
    if response == "solve":
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
