"""Unpacks a bundle into a new venue folder. The file may be from anybody, so nothing in it is trusted.

Entries have a name of a closed list, are stored unpacked, do not overlap and are exactly those of the
manifest; so what is written is never more than the file has. Of venue.toml and the plan only what
`writing_bundle` writes gets out: commands, ports and tables of backends do not, whoever put them in.
"""

import hashlib
import stat
import struct
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tomlkit

from procam.errors import FileFormatError, InputError
from procam.files.atomic import replacing_directory
from procam.files.bundle import names
from procam.files.bundle.manifest import FileEntry, Manifest, entry_of, parse_manifest
from procam.files.bundle.redact import redact, shared_plan
from procam.files.session import Session
from procam.files.session_tables import plan_text
from procam.files.venue.load import load_venue

MOST_MANIFEST = 2**24  # bytes
MOST_SHOWN = 80  # letters of a name in a message
CHUNK = 2**20  # bytes
ENCRYPTED = 1  # a flag of an entry
AGAIN = "ask for the bundle again"
DAMAGES = (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, struct.error)
Entries = dict[str, zipfile.ZipInfo]


def open_bundle(file: Path, venue_dir: Path) -> Manifest:
    """Unpack a bundle into `venue_dir`, which appears when all of it is checked.

    Returns
    -------
    manifest : of what was unpacked; its `redacted` names what was left out, then or now.

    Raises
    ------
    InputError
        The folder exists, or the one above it does not.
    FileFormatError
        The file is no bundle, or one that is damaged, forged or of a later version. Nothing is written.
    """
    if venue_dir.exists() or venue_dir.is_symlink():
        raise InputError(f"{venue_dir} exists; give the name of a folder that does not exist yet")
    if not venue_dir.absolute().parent.is_dir():
        raise InputError(f"{venue_dir}: there is no folder {venue_dir.parent}; make it first")
    with _opened(file) as archive:
        entries = _checked_entries(file, archive)
        manifest = _checked_manifest(file, archive, entries)
        with replacing_directory(venue_dir) as folder:
            for name, entry in manifest.files.items():
                _unpack(file, archive, entries[name], entry, folder / name)
            manifest = _redacted(file, folder, manifest)
            (folder / names.MANIFEST).write_text(manifest.text(), encoding="utf-8")
    return manifest


def read_manifest(file: Path) -> Manifest:
    """The manifest of a bundle whose entries have the sizes that it gives.

    Raises
    ------
    FileFormatError
        The file is no bundle, or one that is truncated, forged or of a later version.
    """
    with _opened(file) as archive:
        return _checked_manifest(file, archive, _checked_entries(file, archive))


@contextmanager
def _opened(file: Path) -> Iterator[zipfile.ZipFile]:
    """An archive; what zipfile raises for damaged ones becomes one sentence."""
    try:
        with zipfile.ZipFile(file) as archive:
            yield archive
    except (FileFormatError, InputError):
        raise
    except (*DAMAGES, ValueError) as error:  # also OverflowError's relatives and wrong encodings
        raise FileFormatError(
            f"{file} is no bundle, or a damaged one ({error}); {AGAIN}"
        ) from error


def _checked_entries(file: Path, archive: zipfile.ZipFile) -> Entries:
    """The entries by name, none of which leads elsewhere or holds more than the file does."""
    found: Entries = {}
    folded = set[str]()
    for info in archive.infolist():
        name = info.orig_filename  # `filename` ends at a zero byte
        if not names.is_allowed(name):
            raise _refusal(file, name, "has a name that no bundle of procam has")
        if name.lower() in folded:
            raise _refusal(file, name, "is there twice, at least where case does not count")
        if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG):
            raise _refusal(file, name, "is a link or another special file")
        if info.flag_bits & ENCRYPTED or info.compress_type != zipfile.ZIP_STORED:
            raise _refusal(
                file, name, "is packed or encrypted, and procam stores files as they are"
            )
        if info.compress_size != info.file_size:
            raise _refusal(file, name, "has two different sizes")
        folded.add(name.lower())
        found[name] = info
    _check_apart(file, found)
    return found


def _check_apart(file: Path, entries: Entries) -> None:
    """Refuse entries that share bytes: a small file could then hold any number of large ones."""
    ordered = sorted(entries.values(), key=lambda info: info.header_offset)
    ends = [info.header_offset for info in ordered[1:]] + [file.stat().st_size]
    for info, end in zip(ordered, ends, strict=True):
        if info.header_offset + info.file_size > end:
            raise _refusal(file, info.filename, "overlaps another one, or the end of the file")


def _checked_manifest(file: Path, archive: zipfile.ZipFile, entries: Entries) -> Manifest:
    """The manifest, which lists the entries and their sizes."""
    info = entries.get(names.MANIFEST)
    if info is None:
        raise FileFormatError(
            f"{file} has no {names.MANIFEST}, so it is no bundle; is it the right file?"
        )
    if info.file_size > MOST_MANIFEST:
        raise _refusal(file, names.MANIFEST, f"is larger than {MOST_MANIFEST // 2**20} MiB")
    manifest = parse_manifest(file / names.MANIFEST, archive.read(info))
    for name in (names.VENUE, names.PLAN, *manifest.files):
        if name not in entries or name not in manifest.files:
            raise _refusal(file, name, "is missing")
    for name in entries.keys() - manifest.files.keys() - {names.MANIFEST}:
        raise _refusal(file, name, "is not in the manifest")
    for name, entry in manifest.files.items():
        if entries[name].file_size != entry.bytes:
            raise _refusal(file, name, "has another size than the manifest gives")
    return manifest


def _unpack(
    file: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo, entry: FileEntry, path: Path
) -> None:
    """Write one file, and compare its hash."""
    path.parent.mkdir(parents=True, exist_ok=True)
    found = hashlib.sha256()
    try:
        with archive.open(info) as source, path.open("xb") as out:
            while part := source.read(CHUNK):
                found.update(part)
                out.write(part)
    except DAMAGES as error:
        raise _refusal(file, info.filename, f"is damaged ({error})") from error
    if found.hexdigest() != entry.sha256:
        raise _refusal(file, info.filename, "has another sha256 than the manifest gives")


def _redacted(file: Path, folder: Path, manifest: Manifest) -> Manifest:
    """Write venue.toml and the plan anew, with what may be shared; returns the manifest of that.

    Masks and responses must have the names that `writing_bundle` gives; a plan that is none is refused.
    """
    try:
        venue, session = load_venue(folder), Session(folder / names.SESSION)
        plan, redacted = shared_plan(session.read_plan()), redact(venue, session)
    except InputError as error:
        raise FileFormatError(str(error).replace(str(folder), str(file))) from error
    place = folder.resolve()
    if any(path != place / name for name, path in redacted.files.items()):
        raise _refusal(file, names.VENUE, "names files that no bundle of procam names")
    texts = {names.VENUE: tomlkit.dumps(redacted.tables), names.PLAN: plan_text(plan)}
    for name, text in texts.items():
        (folder / name).write_bytes(text.encode())
    left_out = [f"{key} (when it was opened)" for key in redacted.removed]
    files = {name: entry_of(text.encode()) for name, text in texts.items()}
    return manifest.model_copy(
        update={"redacted": [*manifest.redacted, *left_out], "files": manifest.files | files}
    )


def _refusal(file: Path, name: str, what: str) -> FileFormatError:
    shown = name if len(name) <= MOST_SHOWN else name[:MOST_SHOWN] + "..."
    return FileFormatError(f"{file}: the entry {shown!r} {what}; nothing was unpacked, {AGAIN}")
