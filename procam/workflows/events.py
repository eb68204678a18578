"""What workflows report while they run: the command line, reports and tests read one stream."""

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
