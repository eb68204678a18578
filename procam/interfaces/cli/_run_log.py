"""The log of a run, VENUE/logs/DATE-COMMAND.log: the command, its progress, what it said, how it ended."""

import sys
import time
from pathlib import Path
from shlex import quote

from procam.files.system import open_here
from procam.interfaces.cli._plain import plain

_logs = list["RunLog"]()  # of the present run, or none


class RunLog:
    """Lines with the seconds since the start; the file appears with the first one.

    A disk that takes no more lines ends the log, not the run.
    """

    def __init__(self, venue_dir: Path, command: str) -> None:
        name = time.strftime("%Y%m%d-%H%M%S")
        self._path, self._started_s = venue_dir / "logs" / f"{name}-{command}.log", time.monotonic()
        self.has_lines, self._ended = False, False
        _logs[:] = [self]

    def write(self, text: str) -> None:
        """Add a line."""
        if self._ended:
            return
        lines = [f"{time.monotonic() - self._started_s:8.1f}  {plain(text)}"]
        if not self.has_lines:
            lines.insert(0, f"{time.strftime('%Y-%m-%d %H:%M:%S')}  {_command_line()}")
        try:
            self._path.parent.mkdir(exist_ok=True)
            with open(
                self._path, "a", encoding="utf-8", errors="replace", opener=open_here
            ) as file:
                file.writelines(f"{line}\n" for line in lines)
        except OSError:
            self._ended = True
        self.has_lines = True


def end_log(text: str) -> None:
    """Write how the run ended, if it has a log with lines; the next run has one of its own."""
    for log in _logs:
        if log.has_lines:
            log.write(text)
    _logs.clear()


def _command_line() -> str:
    return " ".join(["procam", *map(quote, sys.argv[1:])])
