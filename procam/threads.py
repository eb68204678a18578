"""Threads that work beside the one that a signal may stop.

`concurrent.futures` and `threading.Thread` hold locks in Python code: Ctrl-C in such a moment leaves one
locked, and a thread that needs it waits for ever. Here threads meet in C code alone, which a signal
interrupts before it has begun or not at all.
"""

import _thread
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Generic, Self, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_at_work: set["Job[Any]"] = set()


def any_at_work() -> bool:
    """Whether some thread is at a job, which may be to wait at a pipe."""
    return bool(_at_work)


class Job(Generic[Result]):
    """What a thread was given to do."""

    def __init__(self) -> None:
        self._outcome: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()

    def done(self) -> bool:
        """Whether `result` would not wait."""
        return not self._outcome.empty()

    def result(self) -> Result:
        """Wait for what the job gives, or raise its error; once, since it is not kept."""
        found, error = self._outcome.get()
        if error is not None:
            raise error
        result: Result = found
        return result

    def do(self, work: Callable[[], Result]) -> None:
        """Called by the thread."""
        _at_work.add(self)
        try:
            self._end(work(), None)
        except BaseException as error:
            self._end(None, error)

    def _end(self, found: Result | None, error: BaseException | None) -> None:
        _at_work.discard(self)
        self._outcome.put((found, error))


def begin(work: Callable[[], Result]) -> Job[Result]:
    """A job for a thread of its own; a process that ends does not wait for it."""
    job = Job[Result]()
    _thread.start_new_thread(job.do, (work,))
    return job


class Threads:
    """Threads that do jobs in the order they are given.

    A context manager: at the end of the block no further job is begun, and those at work are waited for.
    """

    def __init__(self, count: int) -> None:
        self._jobs: SimpleQueue[tuple[Job[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._ended: SimpleQueue[None] = SimpleQueue()
        self._stopped = False
        self._count = count
        for _ in range(count):
            _thread.start_new_thread(self._run, ())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def give(self, work: Callable[[], Result]) -> Job[Result]:
        """A job for the first thread that is free."""
        job = Job[Result]()
        self._jobs.put((job, work))
        return job

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """A job for each item, given at once; what they give, in the order of the items."""
        jobs = [self.give(partial(work, item)) for item in items]
        return (job.result() for job in jobs)

    def stop(self, patience_s: float | None = None) -> None:
        """Begin no further job, and wait for those at work, `patience_s` for each thread."""
        self._stopped = True
        for _ in range(self._count):
            self._jobs.put(None)
        with suppress(Empty):  # it waits at a pipe, and so may the others
            for _ in range(self._count):
                self._ended.get(timeout=patience_s)

    def _run(self) -> None:
        while (given := self._jobs.get()) is not None and not self._stopped:
            job, work = given
            job.do(work)
            del given, job, work  # a frame must not live until the next one comes
        self._ended.put(None)
