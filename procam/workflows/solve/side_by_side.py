"""Work on several projectors at a time."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from procam.memory import return_buffers
from procam.threads import ThreadPool

WORKERS = 2  # NumPy leaves the other core idle
MOST_BYTES = 2.1e9  # of all workers together; where they need more, one works after the other
Result = TypeVar("Result")


def workers(bytes_each: float) -> int:
    """How many projectors are worked on at a time."""
    return min(WORKERS, max(1, int(MOST_BYTES // bytes_each)))


def side_by_side(
    work: Callable[[str], Result], projectors: Iterable[str], bytes_each: float
) -> Iterator[tuple[str, Result]]:
    """Results by projector, in their order; `bytes_each` is the memory that work on one takes."""
    names = list(projectors)
    with ThreadPool(workers(bytes_each)) as pool:
        for name, result in zip(names, pool.map(work, names), strict=True):
            return_buffers()
            yield name, result
