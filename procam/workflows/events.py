"""Workflows are generators of events that return a result: commands, reports and tests read one stream."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar


@dataclass(frozen=True, slots=True)
class Event:
    """One step done: `done` of `total` in `stage`, and a sentence for people."""

    stage: str
    done: int
    total: int
    text: str


Result = TypeVar("Result")
Steps = Generator[Event, None, Result]  # a workflow
