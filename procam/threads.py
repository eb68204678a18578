"""A pool of threads like that of `concurrent.futures`, for a main thread that signals may interrupt.

There, locks are taken in Python code: a Ctrl-C at that moment leaves one locked, and a thread that needs
it waits for ever. Here threads communicate through C code alone, which a signal interrupts before it
starts or not at all.
"""

import _thread
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Generic, NoReturn, Self, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

SLICE_S = 0.25  # of a wait without an end

_running: set["Future[Any]"] = set()


def any_running() -> bool:
    """Whether some thread runs a function, which may be waiting at a pipe."""
    return bool(_running)


class Future(Generic[Result]):
    """The result of a function that a thread runs."""

    def __init__(self) -> None:
        self._outcome: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()

    def done(self) -> bool:
        """Whether `result` would not wait."""
        return not self._outcome.empty()

    def result(self, patience_s: float | None = None) -> Result:
        """Wait for the result, or raise the function's error; only once, since it is not kept.

        Raises queue.Empty if it is not there in `patience_s`.
        """
        found, error = (
            self._awaited() if patience_s is None else self._outcome.get(timeout=patience_s)
        )
        if error is None:
            result: Result = found
            return result
        try:
            raise error
        finally:
            del error  # its traceback holds this frame, which would hold it

    def _awaited(self) -> tuple[Any, BaseException | None]:
        """The outcome; a signal that came just before a wait began is seen at the end of its slice."""
        while True:
            with suppress(Empty):
                return self._outcome.get(timeout=SLICE_S)

    def run(self, function: Callable[[], Result]) -> None:
        """Called by the thread."""
        _running.add(self)
        try:
            self._set(function(), None)
        except BaseException as error:
            self._set(None, error)

    def _set(self, found: Result | None, error: BaseException | None) -> None:
        _running.discard(self)
        self._outcome.put((found, error))


def start(function: Callable[[], Result]) -> Future[Result]:
    """Run a function in a thread of its own; a process that ends does not wait for it."""
    future = Future[Result]()
    try:
        _running.add(future)  # now, for the process may end before the thread gets its turn
        _thread.start_new_thread(future.run, (function,))
    except BaseException:
        _running.discard(future)
        raise
    return future


class ThreadPool:
    """Threads that run functions in the order in which they are submitted.

    A context manager: at the end of the block no further function is started, and those that run are
    waited for, `patience_s` for each thread if that is given.
    """

    def __init__(self, count: int, patience_s: float | None = None) -> None:
        self._submitted: SimpleQueue[tuple[Future[Any], Callable[[], Any]] | None] = SimpleQueue()
        self._ended: SimpleQueue[None] = SimpleQueue()
        self._count, self._patience_s = count, patience_s
        self._stopped = False
        for _ in range(count):
            _thread.start_new_thread(self._run, ())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped = True
        for _ in range(self._count):
            self._submitted.put(None)
        for _ in range(self._count):
            with suppress(Empty):  # it waits at a pipe
                self._ended.get(timeout=self._patience_s)

    def submit(self, function: Callable[[], Result]) -> Future[Result]:
        """Have the first free thread run a function."""
        if self._stopped:
            _too_late()
        future = Future[Result]()
        self._submitted.put((future, function))
        return future

    def map(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """Submit a call for each item now; iterates over the results in the order of the items."""
        futures = [self.submit(partial(function, item)) for item in items]
        return (future.result() for future in futures)

    def _run(self) -> None:
        while (submitted := self._submitted.get()) is not None:
            future, function = submitted
            future.run(_too_late if self._stopped else function)
            del submitted, future, function  # a frame must not live until the next one comes
        self._ended.put(None)


def _too_late() -> NoReturn:
    raise RuntimeError("not started: the pool of threads has ended")
