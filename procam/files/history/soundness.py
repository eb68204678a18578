"""Checks that history.sqlite is as procam wrote it: its tables, the types of its values, a checksum per row.

SQLite's own check finds damaged pages and rows that an index lacks, but no value that is another. What is
wrong is raised as sqlite3.DatabaseError; `store` adds the file's name and what to do.
"""

import sqlite3
import zlib
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Any

TABLES = "runs", "devices", "calibrations", "figures", "files"
SUM = "checksum"


def add_functions(db: sqlite3.Connection) -> list[BaseException]:
    """Give a connection the functions that `seal` and `check` use.

    What stops one of them, as Ctrl-C does, is in the list that is returned: SQLite itself drops it, and
    says only that a function failed.
    """
    stopped = list[BaseException]()

    def kept(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*values: object) -> Any:
            try:
                return function(*values)
            except BaseException as error:
                stopped.append(error)
                raise

        return call

    db.create_function("row_checksum", -1, kept(_row_checksum), deterministic=True)
    db.create_function("is_time", 1, kept(_is_time), deterministic=True)
    return stopped


def seal(db: sqlite3.Connection) -> None:
    """Give all rows that are new or were changed, and so have none, their checksum."""
    for table in TABLES:
        db.execute(f"UPDATE {table} SET {SUM} = {_computed(db, table)} WHERE {SUM} = ''")


def check(db: sqlite3.Connection, scripts: Sequence[str]) -> None:
    """Refuse a file that is not what these scripts make, or whose rows are not as they were written.

    Raises
    ------
    sqlite3.DatabaseError
        It is damaged, or of another program.
    """
    (found,) = db.execute("PRAGMA integrity_check(1)").fetchone()
    if found != "ok":
        raise sqlite3.DatabaseError(" ".join(str(found).split()))
    if _schema(db) != _schema_of(scripts):
        raise sqlite3.DatabaseError("its tables are not those that procam makes")
    for table in TABLES if scripts else ():
        if row := db.execute(
            f"SELECT rowid FROM {table} WHERE {_wrong(db, table)} LIMIT 1"
        ).fetchone():
            raise sqlite3.DatabaseError(f"row {row[0]} of {table} differs from what was written")


def _schema(db: sqlite3.Connection) -> list[tuple[object, ...]]:
    """Tables and indexes, and the columns of each."""
    return db.execute(
        "SELECT m.type, m.name, m.tbl_name, c.name, c.type, c.[notnull], c.pk FROM sqlite_master m "
        "JOIN pragma_table_info(m.name) c UNION ALL "
        "SELECT type, name, tbl_name, NULL, NULL, NULL, NULL FROM sqlite_master WHERE type <> 'table' "
        "ORDER BY 2, 4"
    ).fetchall()


def _schema_of(scripts: Sequence[str]) -> list[tuple[object, ...]]:
    db = sqlite3.connect(":memory:")
    try:
        db.executescript(";".join(scripts))
        return _schema(db)
    finally:
        db.close()


def _columns(db: sqlite3.Connection, table: str) -> dict[str, str]:
    """Type of each column, in their order."""
    return dict(db.execute("SELECT name, type FROM pragma_table_info(?)", (table,)).fetchall())


def _computed(db: sqlite3.Connection, table: str) -> str:
    """SQL for the checksum of a row."""
    return f"row_checksum({', '.join(name for name in _columns(db, table) if name != SUM)})"


def _wrong(db: sqlite3.Connection, table: str) -> str:
    """SQL for whether a row's values are of other types than its columns, or differ from its checksum."""
    columns = _columns(db, table)
    found = [f"typeof({n}) NOT IN ('{kind.lower()}', 'null')" for n, kind in columns.items()]
    if table == "runs":
        found.append("NOT is_time(started_at)")
    if SUM in columns:  # none in files of the first version
        found.append(f"{SUM} <> {_computed(db, table)}")
    return " OR ".join(found)


def _row_checksum(*values: object) -> str:
    return f"{zlib.crc32(repr(values).encode()):08x}"


def _is_time(text: object) -> bool:
    """Whether it is an instant that can be shown as one of any place."""
    try:
        datetime.fromisoformat(str(text)).astimezone().isoformat()
        return "+" in str(text)
    except (ValueError, OverflowError, OSError):
        return False
