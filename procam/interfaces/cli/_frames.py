"""Frames of projectors, as commands report them."""

from collections.abc import Iterator
from pathlib import Path

from procam.interfaces.cli._output import Output
from procam.workflows.events import Event


def report_frames(events: Iterator[Event], source: Path, output: Output) -> None:
    """Follow a run that makes frames of projectors, and name what it has written."""
    paths = output.follow_frames(events, quiet=source.is_file())["frames"]
    for path in paths:
        output.say(f"{path} written")
    output.finish({"frames": paths})
