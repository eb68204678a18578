"""Events that workflows report while they run: the command line, reports and tests read one stream."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Event:
    """One step done: `done` of `total` in `stage`, a sentence for people, data for machines."""

    stage: str
    done: int
    total: int
    text: str
    data: dict[str, Any] = field(default_factory=dict)


@contextmanager
def ended_with(events: Iterator[Event]) -> Iterator[None]:
    """End a workflow with the block, also where it stands between two events.

    Without this it would keep its devices until somebody looks for it.
    """
    try:
        yield
    finally:
        if isinstance(events, Generator):
            events.close()
