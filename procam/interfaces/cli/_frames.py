"""Frames of projectors, as commands report them."""

from pathlib import Path

from procam.interfaces.cli._output import Output
from procam.workflows.events import Steps
from procam.workflows.playout.warp import ProjectorFrames


def report_frames(steps: Steps[ProjectorFrames], source: Path, output: Output) -> None:
    """Follow a run that makes frames of projectors, and name what it has written."""
    paths = output.follow_frames(steps, quiet=source.is_file()).paths
    for path in paths:
        output.say(f"{path} written")
    output.finish({"frames": paths})
