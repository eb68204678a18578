"""Generators that return a result."""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

Item = TypeVar("Item")
Other = TypeVar("Other")
Result = TypeVar("Result")


def result_of(steps: Generator[Any, None, Result]) -> Result:
    """Run a generator to its end; what it returns."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def converted(
    steps: Generator[Item, None, Result], convert: Callable[[Item], Other]
) -> Generator[Other, None, Result]:
    """Each item converted, and the same result."""
    while True:
        try:
            item = next(steps)
        except StopIteration as end:
            return end.value
        yield convert(item)
