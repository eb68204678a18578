"""Progress of commands that make frames."""

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from procam.interfaces.cli._memory import keep_large_buffers
from procam.interfaces.cli._output import Output

if TYPE_CHECKING:
    from procam.workflows.events import Event


def follow_frames(events: "Iterator[Event]", output: Output, *, quiet: bool) -> dict[str, Any]:
    """Data of the last event; a bar on a terminal, where loading it takes less than the frames do."""
    if sys.stderr.isatty() and not quiet:
        return output.follow(events)
    keep_large_buffers()
    data: dict[str, Any] = {}
    for event in events:
        data = event.data
    return data
