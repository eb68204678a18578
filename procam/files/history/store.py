"""history.sqlite: its tables, its versions, and its errors in plain sentences.

A connection lives for one transaction. The file is in WAL mode, so that it can be read while it is written,
and each commit is flushed to disk.
"""

import errno
import hashlib
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from procam.errors import FileFormatError

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
)
SCHEMA = len(MIGRATIONS)
FULL = sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR
REFUSED = sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM
DAMAGED = sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB
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
        The disk is full, or may not be written.
    """
    path = venue_dir / NAME
    _refuse_folder(path)
    with _worded(path), _connected(path) as db:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = FULL")
        db.execute("BEGIN IMMEDIATE")
        try:
            _migrate(path, db)
            yield db
            db.execute("COMMIT")
        except BaseException:
            if db.in_transaction:
                db.execute("ROLLBACK")
            raise


@contextmanager
def readable(venue_dir: Path) -> Iterator[sqlite3.Connection | None]:
    """A venue's history to read; None if it has none yet."""
    path = venue_dir / NAME
    _refuse_folder(path)
    if not path.is_file():
        yield None
        return
    with _worded(path), _connected(path) as db:
        db.execute("BEGIN")  # one state of the file for all that is read
        version = _version(path, db)
        yield db if version else None


def _refuse_folder(path: Path) -> None:
    if path.is_dir():
        raise FileFormatError(
            f"{path} is a folder, and the venue's history is a file of that name; move the folder away"
        )


@contextmanager
def _connected(path: Path) -> Iterator[sqlite3.Connection]:
    db = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None)
    try:
        db.execute("PRAGMA foreign_keys = ON")
        yield db
    finally:
        db.close()


def _migrate(path: Path, db: sqlite3.Connection) -> None:
    for script in MIGRATIONS[_version(path, db) :]:
        for statement in script.split(";"):
            db.execute(statement)
    db.execute(f"PRAGMA user_version = {SCHEMA}")


def _version(path: Path, db: sqlite3.Connection) -> int:
    version = int(db.execute("PRAGMA user_version").fetchone()[0])
    if version > SCHEMA:
        raise FileFormatError(
            f"{path} was written by a later version of procam (schema {version}, and this version reads "
            f"{SCHEMA}); install that version. Nothing was changed"
        )
    return version


@contextmanager
def _worded(path: Path) -> Iterator[None]:
    """Errors of SQLite as those of procam and of the system."""
    try:
        yield
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", 0) & PRIMARY
        if code in FULL:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path)) from error
        if code in REFUSED:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES), str(path)) from error
        if code == sqlite3.SQLITE_BUSY:
            raise FileFormatError(
                f"{path} is in use by another program; close that and run the command again"
            ) from error
        if code in DAMAGED:
            raise FileFormatError(
                f"{path} is damaged ({error}); restore it from a backup, or move it away: the next run "
                "begins a new one, and calibrations and captures are not touched"
            ) from error
        raise


def file_digest(path: Path) -> str:
    """The sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
