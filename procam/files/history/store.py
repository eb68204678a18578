"""history.sqlite: its tables, its versions, and its errors in plain sentences.

A connection lives for one transaction. The file is in WAL mode, so that it can be read while it is written,
and each commit is flushed to disk. The file may be damaged or a stranger's, so it is checked before each
use (`procam.files.history.soundness`): every row has a checksum, written with it.
"""

import errno
import hashlib
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from procam.errors import FileFormatError
from procam.files.history import soundness
from procam.files.system import refuse_link

NAME = "history.sqlite"
BUSY_S = 20.0  # until another reader or writer has ended
# each step migrates a file from the version of its place in the list to the next
MIGRATIONS = (
    """
    CREATE TABLE runs (
        id INTEGER PRIMARY KEY, command TEXT NOT NULL, procam TEXT NOT NULL,
        started_at TEXT NOT NULL, elapsed_s REAL, outcome TEXT NOT NULL, message TEXT NOT NULL,
        in_use TEXT
    );
    CREATE TABLE devices (
        run INTEGER NOT NULL REFERENCES runs, kind TEXT NOT NULL, name TEXT NOT NULL,
        backend TEXT NOT NULL, width INTEGER, height INTEGER, PRIMARY KEY (run, kind, name)
    );
    CREATE TABLE calibrations (
        name TEXT PRIMARY KEY, run INTEGER NOT NULL REFERENCES runs, session TEXT NOT NULL
    );
    CREATE TABLE figures (
        run INTEGER NOT NULL REFERENCES runs, calibration TEXT REFERENCES calibrations,
        name TEXT NOT NULL, value REAL, sigma REAL, unit TEXT NOT NULL,
        op TEXT, goal REAL, passed INTEGER
    );
    CREATE INDEX figures_of_run ON figures (run);
    CREATE INDEX figures_by_name ON figures (name);
    CREATE TABLE files (
        run INTEGER NOT NULL REFERENCES runs, path TEXT NOT NULL, sha256 TEXT NOT NULL,
        bytes INTEGER NOT NULL, PRIMARY KEY (path, run)
    );
    """,
    # '' until the row's values are final; `soundness.seal` then fills it
    ";".join(
        f"ALTER TABLE {table} ADD COLUMN checksum TEXT NOT NULL DEFAULT ''"
        for table in soundness.TABLES
    ),
)
SCHEMA = len(MIGRATIONS)
FULL = sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR
REFUSED = sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM
PRIMARY = 0xFF  # the low byte of an extended code


@contextmanager
def written(venue_dir: Path) -> Iterator[sqlite3.Connection]:
    """A transaction on a venue's history, which is made or brought to this version first.

    It is committed when the block ends without an error; hold the venue's lock.

    Raises
    ------
    FileFormatError
        The file is damaged, of a later version of procam, or a folder.
    OSError
        The disk is full, or may not be written; the file is a link.
    """
    path = venue_dir / NAME
    with suppress(FileExistsError):
        path.touch(exist_ok=False)  # SQLite would make the target of a link
    _require_file(path)
    with _worded(path), _connected(path) as db:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        db.execute("BEGIN IMMEDIATE")
        try:
            _migrate(path, db)
            yield db
            soundness.seal(db)
            db.execute("COMMIT")
        except BaseException:
            if db.in_transaction:
                db.execute("ROLLBACK")
            raise


@contextmanager
def readable(venue_dir: Path) -> Iterator[sqlite3.Connection | None]:
    """A venue's history to read; None if it has none yet."""
    path = venue_dir / NAME
    _require_file(path)
    if not path.is_file():
        yield None
        return
    with _worded(path), _connected(path, as_it_is=_cannot_change(path)) as db:
        db.execute("BEGIN")  # one state of the file for all that is read
        version = _checked_version(path, db)
        yield db if version else None


def _cannot_change(path: Path) -> bool:
    """Whether a history is on a disk that is mounted to be read, where SQLite can make no files beside it."""
    log = path.with_name(f"{NAME}-wal")
    return not os.access(path.parent, os.W_OK) and not (log.is_file() and log.stat().st_size)


def _require_file(path: Path) -> None:
    refuse_link(path)
    if path.is_dir():
        raise FileFormatError(
            f"{path} is a folder, and the venue's history is a file of that name; move the folder away"
        )


@contextmanager
def _connected(path: Path, *, as_it_is: bool = False) -> Iterator[sqlite3.Connection]:
    uri = f"{path.absolute().as_uri()}{'?mode=ro&immutable=1' if as_it_is else ''}"
    db = sqlite3.connect(uri, timeout=BUSY_S, isolation_level=None, uri=True)
    try:
        db.execute("PRAGMA trusted_schema = OFF")
        db.execute("PRAGMA foreign_keys = ON")
        stopped = soundness.add_functions(db)
        try:
            yield db
        except sqlite3.Error:
            if stopped:
                raise stopped[0] from None
            raise
    finally:
        db.close()


def _migrate(path: Path, db: sqlite3.Connection) -> None:
    for script in MIGRATIONS[_checked_version(path, db) :]:
        for statement in script.split(";"):
            db.execute(statement)
    db.execute(f"PRAGMA user_version = {SCHEMA}")


def _checked_version(path: Path, db: sqlite3.Connection) -> int:
    """The version of a file whose tables and rows are sound; 0 of an empty one."""
    version = int(db.execute("PRAGMA user_version").fetchone()[0])
    if version > SCHEMA:
        raise FileFormatError(
            f"{path} was written by a later version of procam (schema {version}, and this version reads "
            f"{SCHEMA}); install that version. Nothing was changed"
        )
    if version < 0:
        raise sqlite3.DatabaseError(f"its version is {version}")
    soundness.check(db, MIGRATIONS[:version])
    return version


@contextmanager
def _worded(path: Path) -> Iterator[None]:
    """Errors of SQLite as those of procam and of the system."""
    try:
        yield
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # also of a message's names
        if isinstance(error, sqlite3.ProgrammingError):  # of procam, not of the file
            raise
        code = getattr(error, "sqlite_errorcode", 0) & PRIMARY
        if code in FULL:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        if code in REFUSED:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(path)) from error
        if code == sqlite3.SQLITE_BUSY:
            raise FileFormatError(
                f"{path} is in use by another program; close that and run the command again"
            ) from error
        raise FileFormatError(
            f"{path} is damaged ({error}); restore it from a backup, or move it away: the next run "
            "begins a new one, and calibrations and captures are not touched"
        ) from error


def file_digest(path: Path) -> str:
    """The sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def storable(text: object) -> str:
    """Text that SQLite takes: halves of characters, which names of files may have, are written out."""
    return str(text).encode("utf-8", "backslashreplace").decode()
