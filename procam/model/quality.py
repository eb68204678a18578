"""Figures: a number that knows its unit, its goal and whether it meets it."""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

Comparison = Literal["<=", ">=", "==", "abs<="]
_COMPARE: dict[Comparison, Callable[[Any, Any], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "abs<=": lambda value, limit: abs(value) <= limit,  # for signed errors
}


@dataclass(frozen=True, slots=True)
class Goal:
    """What a figure should be, such as Goal("<=", 0.5)."""

    op: Comparison
    value: float | bool


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a run (design.md s.3).

    Attributes
    ----------
    value : the number, a list of numbers, or a verdict.
    unit : its unit, "-" for ratios.
    goal : what it should be; None if it is only reported.
    samples : how many independent things it was taken over.
    note : one plain sentence for the reader.
    """

    value: float | bool | list[float]
    unit: str
    goal: Goal | None = None
    samples: int = 1
    note: str = ""

    @property
    def passed(self) -> bool | None:
        """Whether the goal is met; None without one. NaN never passes."""
        if self.goal is None or isinstance(self.value, list):
            return None
        return bool(_COMPARE[self.goal.op](self.value, self.goal.value))

    def as_dict(self) -> dict[str, Any]:
        """The figure as summary.json carries it."""
        goal = None if self.goal is None else {"op": self.goal.op, "value": self.goal.value}
        return {
            "value": self.value,
            "unit": self.unit,
            "goal": goal,
            "pass": self.passed,
            "samples": self.samples,
            "note": self.note,
        }
