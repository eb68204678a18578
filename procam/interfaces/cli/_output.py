"""Text or one JSON document, progress on a terminal, and the log of a run: VENUE/logs/DATE-COMMAND.log.

Text for a terminal has nothing in it that would steer it: names and messages may come from a stranger's file.
"""

import json
import math
import sys
import time
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, TypeVar

import typer

from procam.files.system import open_here

if TYPE_CHECKING:
    from procam.model.calibration import Calibration
    from procam.model.provenance import Note
    from procam.model.quality import Figure
    from procam.workflows.events import Event, Result, Steps
    from procam.workflows.playout.compensate import CompensatedClip
    from procam.workflows.playout.warp import ProjectorFrames

    Frames = TypeVar("Frames", CompensatedClip, ProjectorFrames)


LINE_EVERY_S = 5.0  # of progress in a file
# control, format (also the direction of writing), halves of characters
STEERING = ("Cc", "Cf", "Cs")
KEPT = "\n\t"
_logs = list["RunLog"]()  # of the present run, or none


class Output:
    """What a command prints: text and progress for people, or one document for machines (`as_json`).

    With `log` all of it is kept in the venue's logs too.
    """

    def __init__(self, as_json: bool, log: "RunLog | None" = None) -> None:
        self.as_json, self._log = as_json, log

    def say(self, text: str) -> None:
        """Print a line for people."""
        self._keep(text)
        if not self.as_json:
            sys.stdout.write(plain(text) + "\n")

    def notes(self, calibration: "Calibration", compared: Sequence[str]) -> list[str]:
        """Print the warnings of a solve and of its comparison, one per line, and return them."""
        lines = [*calibration.provenance.note_lines, *compared]
        for line in lines:
            self.say(f"note: {line}")
        return lines

    def warn(self, notes: "Sequence[Note | str]") -> None:
        """Print notes to stderr, where scripts see them too."""
        for note in notes:
            self._keep(f"note: {note}")
            sys.stderr.write(f"note: {plain(str(note))}\n")

    def _keep(self, text: str) -> None:
        if self._log:
            self._log.write(text)

    def finish(self, document: Mapping[str, Any]) -> None:
        """Print the one document for machines."""
        if self.as_json:
            sys.stdout.write(json.dumps(document, indent=1) + "\n")

    def follow(self, steps: "Steps[Result]") -> "Result":
        """Run a workflow to its end, show its progress on stderr, and return its result.

        On a terminal that is a bar; in a file or a pipe a line every few seconds.
        """
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        from procam.memory import keep_large_buffers

        keep_large_buffers()
        console, result = Console(stderr=True), list["Result"]()
        columns = (TextColumn("{task.fields[stage]:>8}"), BarColumn(30))
        tail = (TextColumn("{task.completed}/{task.total}"), TimeElapsedColumn())
        text = TextColumn("{task.description}", markup=False)  # [[fiducials]] is no markup
        quiet = self.as_json or not console.is_terminal
        lines = None if self.as_json or console.is_terminal else _ProgressLines()

        def events() -> "Iterator[Event]":
            result.append((yield from steps))

        with (
            closing(steps),
            Progress(*columns, *tail, text, console=console, disable=quiet) as progress,
        ):
            task = progress.add_task("", stage="", total=None)
            for event in events():
                progress.update(
                    task,
                    completed=event.done,
                    total=event.total,
                    description=plain(event.text),
                    stage=event.stage,
                )
                self._keep(f"{event.stage} {event.done}/{event.total} {event.text}")
                if lines:
                    lines.show(event)
        return result[0]

    def follow_frames(self, steps: "Steps[Frames]", *, quiet: bool) -> "Frames":
        """The same for frames, whose first should not wait for the bar's import: only on a terminal.

        Notes of the result go to stderr.
        """
        from procam.generators import result_of
        from procam.memory import keep_large_buffers

        keep_large_buffers()
        is_terminal = sys.stderr.isatty() and not quiet
        found = self.follow(steps) if is_terminal else result_of(steps)
        self.warn(found.notes)
        return found

    def table(self, figures: Mapping[str, "Figure"]) -> None:
        """Print figures with goal and verdict."""
        for name, figure in figures.items():
            verdict = {True: "pass", False: "FAIL", None: ""}[figure.passed]
            goal = f"{figure.goal.op} {figure.goal.value}" if figure.goal else ""
            unit = "" if figure.unit == "-" else figure.unit
            self.say(f"  {name:30} {_short(figure.value):>28} {unit:7} {goal:14} {verdict}")


class _ProgressLines:
    """Progress where no bar can move: a line at the beginning and one every few seconds."""

    def __init__(self) -> None:
        self._next_s = -math.inf if _is_file(sys.stderr) else math.inf

    def show(self, event: "Event") -> None:
        """Print a line if it is time for one."""
        if time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + LINE_EVERY_S
            sys.stderr.write(f"{event.stage} {event.done}/{event.total} {plain(event.text)}\n")
            sys.stderr.flush()


def _is_file(stream: Any) -> bool:
    """Whether the system knows the stream; that of a notebook or a test is none."""
    try:
        stream.fileno()
    except (AttributeError, OSError):  # io.UnsupportedOperation is one
        return False
    return True


def as_dicts(figures: Mapping[str, "Figure"]) -> dict[str, dict[str, Any]]:
    """Figures as JSON has them."""
    return {name: figure.as_dict() for name, figure in figures.items()}


def exit_if_missed(figures: Mapping[str, "Figure"]) -> None:
    """End the command with exit code 1 if a figure misses its goal."""
    if any(figure.passed is False for figure in figures.values()):
        raise typer.Exit(1)


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return " ".join(f"{v:.4g}" for v in value)
    return f"{value:.4g}"


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


def plain(text: str) -> str:
    r"""The text with control characters written out, but for line feeds and tabs.

    >>> print(plain("\x1b[2J south"))
    \x1b[2J south
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(_written_out(c) for c in text)


def plain_line(text: str) -> str:
    """The same as one line."""
    return plain(" ".join(text.split("\n")))


def _written_out(letter: str) -> str:
    if letter in KEPT or unicodedata.category(letter) not in STEERING:
        return letter
    return letter.encode("unicode_escape").decode()
