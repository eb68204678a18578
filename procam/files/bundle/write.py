"""Writes a bundle of a session; the same session gives the same bytes."""

import json
import stat
import zipfile
from collections.abc import Collection, Generator, Iterator
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import tomlkit

from procam.errors import FileFormatError, InputError
from procam.files.atomic import replacing
from procam.files.bundle import names
from procam.files.bundle.manifest import FileEntry, Manifest, entry_of
from procam.files.bundle.original import original_figures
from procam.files.bundle.pictures import frame_bytes, mask_bytes, picture_bytes, response_bytes
from procam.files.bundle.redact import ALWAYS, Redacted, redact, shared_plan
from procam.files.obj import shared_text
from procam.files.session import Session, digest
from procam.files.session_tables import StoredFrame, plan_text
from procam.files.venue.load import Venue
from procam.model.plan import Plan, Shot

FIRST = (1980, 1, 1, 0, 0, 0)  # zip's earliest time
UNIX = 3  # whatever system writes it
File = tuple[str, bytes]  # name and content


class _Taken(NamedTuple):
    """A shot at one exposure, its entry in the index and when it started [s], from the first one."""

    shot: Shot
    exposure_s: float
    entry: StoredFrame
    started_s: float


def writing_bundle(
    venue: Venue, session: Session, out: Path
) -> Generator[tuple[int, int], None, Manifest]:
    """Write `out`, a zip file that appears when it is complete; returns its manifest.

    Yields how many photographs are written, and of how many: a large one takes seconds.

    Raises
    ------
    InputError
        The session has no frames, or venue.toml names files outside the venue's folder.
    FileFormatError
        A file is missing or damaged.
    """
    redacted, plan = redact(venue, session), shared_plan(session.read_plan())
    taken = _taken(venue, session, plan)
    total = sum(map(len, taken.values()))
    if not total:
        raise InputError(
            f"{session.directory}: no frames are stored, so there is nothing to solve; give a session that "
            "was captured, and whose captures were not pruned"
        )
    files, done = dict[str, FileEntry](), 0
    with replacing(out) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, content in _files(venue, session, plan, redacted, taken):
            _require_allowed(session, name, files)
            files[name] = entry_of(content)
            archive.writestr(_header(name), content)
            done += name.endswith(".tif")
            yield done, total
        manifest = Manifest(
            procam=version("procam"),
            frames=total,
            planned=plan.exposures * len(taken),
            redacted=[*redacted.removed, *ALWAYS],
            files=files,
        )
        archive.writestr(_header(names.MANIFEST), manifest.text())
    return manifest


def _taken(venue: Venue, session: Session, plan: Plan) -> dict[str, list[_Taken]]:
    """Stored frames of the plan by camera, in its order."""
    stored = {camera: session.stored(camera) for camera in venue.cameras}
    times = [entry.started_s for entries in stored.values() for entry in entries.values()]
    first = min(times, default=0.0)
    return {
        camera: [
            _Taken(shot, exposure, entry, entry.started_s - first)
            for shot in plan.shots
            for exposure in shot.exposures_s
            if (entry := entries.get((shot.id, exposure)))
        ]
        for camera, entries in stored.items()
    }


def _files(
    venue: Venue,
    session: Session,
    plan: Plan,
    redacted: Redacted,
    taken: dict[str, list[_Taken]],
) -> Iterator[File]:
    """Names and contents, one after the other: a session may be larger than the memory."""
    yield names.README, resources.files(__package__).joinpath("readme.txt").read_bytes()
    yield names.VENUE, tomlkit.dumps(redacted.tables).encode()
    for name, path in redacted.files.items():
        yield name, _content(name, path)
    yield names.PLAN, plan_text(plan).encode()
    for pattern in sorted({shot.pattern for shot in plan.shots if shot.pattern}):
        yield f"{names.SESSION}/{pattern}", picture_bytes(session.directory / pattern)
    for camera, frames in taken.items():
        yield from _camera_files(venue, session, camera, frames)
    figures = original_figures(venue.directory, session.directory.name)
    if figures is not None:
        yield names.ORIGINAL, figures.encode()


def _content(name: str, path: Path) -> bytes:
    """What a bundle has of a file that venue.toml names."""
    if name.endswith(".obj"):
        return shared_text(path).encode()
    return response_bytes(path) if name.endswith(".csv") else mask_bytes(path)


def _camera_files(
    venue: Venue, session: Session, camera: str, frames: list[_Taken]
) -> Iterator[File]:
    """The frames of a camera, each checked against its entry, and the index of them."""
    folder, lines = f"{names.SESSION}/captures/{camera}", list[str]()
    for shot, exposure_s, entry, started_s in frames:
        counts = session.load(camera, shot, exposure_s, venue.cameras[camera].size).counts
        changed = {
            "file": f"{shot.id}@{exposure_s:g}.tif",
            "started_s": started_s,
            "ended_s": started_s + entry.ended_s - entry.started_s,
            "sha256": digest(counts),
        }
        lines.append(json.dumps(entry.model_copy(update=changed).model_dump()) + "\n")
        yield f"{folder}/{changed['file']}", frame_bytes(counts)
    if lines:
        yield f"{folder}/index.jsonl", "".join(lines).encode()


def _require_allowed(session: Session, name: str, before: Collection[str]) -> None:
    """Refuse names that `open_bundle` would refuse."""
    if not names.is_allowed(name) or name.lower() in map(str.lower, before):
        raise FileFormatError(
            f"{session.directory}: a bundle cannot hold {name!r}, as some systems have no file of that name, "
            "or another by it; rename the camera, projector or shot"
        )


def _header(name: str) -> zipfile.ZipInfo:
    header = zipfile.ZipInfo(name, FIRST)
    header.create_system = UNIX
    header.external_attr = (stat.S_IFREG | 0o644) << 16
    return header
