"""Figures of a report: a value with unit, goal and verdict."""

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
    """The goal of a figure, such as Goal("<=", 0.5)."""

    op: Comparison
    value: float | bool


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a run (docs/figures.md).

    Attributes
    ----------
    value : the number, a list of numbers, or a verdict.
    unit : its unit, "-" for ratios.
    goal : None if the figure is only reported.
    samples : number of independent observations behind it.
    note : one plain sentence for the reader.
    sigma : standard error of the value, or of each; None where none is known.
    """

    value: float | bool | list[float]
    unit: str
    goal: Goal | None = None
    samples: int = 1
    note: str = ""
    sigma: float | list[float] | None = None

    @property
    def passed(self) -> bool | None:
        """Whether the goal is met; None without one. NaN never passes."""
        if self.goal is None or isinstance(self.value, list):
            return None
        return bool(_COMPARE[self.goal.op](self.value, self.goal.value))

    def as_dict(self) -> dict[str, Any]:
        """The figure as it is stored in summary.json."""
        goal = None if self.goal is None else {"op": self.goal.op, "value": self.goal.value}
        return {
            "value": self.value,
            "unit": self.unit,
            "goal": goal,
            "pass": self.passed,
            "samples": self.samples,
            "note": self.note,
            "sigma": self.sigma,
        }
