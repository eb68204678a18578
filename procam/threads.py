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
from typing import Any, Generic, NoReturn, Self, TypeVar

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
        if error is None:
            result: Result = found
            return result
        try:
            raise error
        finally:
            del error  # its traceback holds this frame, and that would hold it

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

    A context manager: at the end of the block no further job is begun, and those at work are waited for,
    `patience_s` for each thread if that is given.
    """

    def __init__(self, count: int, patience_s: float | None = None) -> None:
        self._jobs: SimpleQueue[tuple[Job[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._ends: SimpleQueue[None] = SimpleQueue()
        self._count, self._patience_s = count, patience_s
        self._stopped = False
        for _ in range(count):
            _thread.start_new_thread(self._run, ())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped = True
        for _ in range(self._count):
            self._jobs.put(None)
        for _ in range(self._count):
            with suppress(Empty):  # it waits at a pipe
                self._ends.get(timeout=self._patience_s)

    def give(self, work: Callable[[], Result]) -> Job[Result]:
        """A job for the first thread that is free."""
        if self._stopped:
            _too_late()
        job = Job[Result]()
        self._jobs.put((job, work))
        return job

    def map(self, work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """A job for each item, given at once; what they give, in the order of the items."""
        jobs = [self.give(partial(work, item)) for item in items]
        return (job.result() for job in jobs)

    def _run(self) -> None:
        while (given := self._jobs.get()) is not None:
            job, work = given
            job.do(_too_late if self._stopped else work)
            del given, job, work  # a frame must not live until the next one comes
        self._ends.put(None)


def _too_late() -> NoReturn:
    raise RuntimeError("this job is not begun: its threads have ended")
