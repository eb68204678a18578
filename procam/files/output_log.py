"""The log of the files that a run has written, so that a run that was killed resumes where it stopped."""

import json
import threading
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from procam.files.atomic import append_line, read_lines


class OutputLog:
    """One line of JSON for each output file, in a log beside the files.

    A line holds the output's name and size, the source's size and time, a key of everything else that
    determines the output, values that the run needs again, and a checksum of all this.

    Parameters
    ----------
    path : of the log. key : of the calibration, the settings and the program.
    others : logs of other runs for files in the same folder, which are read too.
    """

    def __init__(self, path: Path, key: str, others: Sequence[Path] = ()) -> None:
        self.path, self._key = path, key
        self._lock = threading.Lock()
        logs = dict.fromkeys([*others, path])
        entries = [_entry(line) for log in logs for line in read_lines(log)]
        entries.sort(key=lambda entry: int(entry.get("written_ns", 0)))
        self._entries = {str(entry.get("out")): entry for entry in entries}

    def kept(self, out: Path, source: list[int]) -> dict[str, Any] | None:
        """The values stored with an output that is complete and made from the source as it is now.

        None if the output has to be made again. `source` is the source's `file_state`.
        """
        entry = self._entries.get(out.name)
        if entry is None or entry.get("key") != self._key or not out.is_file():
            return None
        same = entry.get("size") == out.stat().st_size and entry.get("source") == source
        return entry["kept"] if same else None

    def add(self, out: Path, source: list[int], kept: dict[str, Any]) -> None:
        """Log an output that is written; `source` is the source's `file_state` before it was read."""
        entry = {
            "out": out.name,
            "size": out.stat().st_size,
            "source": source,
            "key": self._key,
            "kept": kept,
            "written_ns": time.time_ns(),
        }
        with self._lock:
            append_line(self.path, json.dumps({**entry, "checksum": _checksum(entry)}))


def _entry(line: str) -> dict[str, Any]:
    """A line of the log; {} for a damaged one, so that its file is made again."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(found, dict) or found.pop("checksum", None) != _checksum(found):
        return {}
    return found


def _checksum(entry: dict[str, Any]) -> str:
    return f"{zlib.crc32(json.dumps(entry, sort_keys=True).encode()):08x}"


def file_state(path: Path) -> list[int]:
    """Size [byte] and modification time [ns] of a file, which change when its content does."""
    stat = path.stat()
    return [stat.st_size, stat.st_mtime_ns]
