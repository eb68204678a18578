"""Signals that stop a run: Ctrl-C, TERM and HUP (a closed terminal) alike, and only the first of them.

Projectors must be dark afterwards, so what makes them dark is not interrupted at all.
"""

import os
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from types import CodeType, FrameType
from typing import Any, Protocol, TypeVar

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
STDERR = 2  # sys.stderr may be no file, as in a notebook
WAIT = b"procam: stopping; projectors are being made dark, please wait\n"
Function = TypeVar("Function", bound=Callable[..., Any])


class LeavesDark(Protocol):
    """A rig; `dark` is whether it was left, and all projectors are confirmed to be dark."""

    dark: bool


@dataclass
class Run:
    """What happened between the begin and the end of `interruptible`.

    Attributes
    ----------
    stopped_by : number of the first signal; None if there was none.
    unfinished : what must still be done before the process may end, such as darkening a rig.
    rigs : those that were used.
    pending : whether the signal came in an `uninterruptible` function and has raised nothing yet.
    """

    stopped_by: int | None = None
    unfinished: list[Callable[[], None]] = field(default_factory=list)
    rigs: list["LeavesDark"] = field(default_factory=list)
    pending: bool = False

    @property
    def left_dark(self) -> bool:
        """Whether a rig was used, and all projectors of all rigs are confirmed to be dark."""
        return bool(self.rigs) and all(rig.dark for rig in self.rigs)

    def raise_pending(self) -> None:
        """Raise the KeyboardInterrupt that is pending; only in the main thread, as signals do."""
        if self.pending and threading.current_thread() is threading.main_thread():
            self.pending = False
            raise KeyboardInterrupt


_runs: list[Run] = []  # the present one, or none
_uninterruptible: set[CodeType] = set()


def current_run() -> Run:
    """The run that `interruptible` began; outside of one, a new one that is not used."""
    return _runs[0] if _runs else Run()


def uninterruptible(function: Function) -> Function:
    """Mark a function that, with all it calls, no signal of a run interrupts: it calls `raise_pending`."""
    _uninterruptible.add(function.__code__)
    return function


class interruptible:  # noqa: N801
    """A block in which the first of `SIGNALS` raises KeyboardInterrupt, and all others are ignored.

    At its end it does what is `unfinished`. If a signal came and the process ends with the block, further
    ones stay ignored, so that it can say what it has done. Inside another such block, and outside the
    main thread, where Python allows no handlers, it changes nothing. A signal that is ignored already
    (nohup) stays ignored.
    """

    def __init__(self, process_ends: bool = False) -> None:
        self._process_ends = process_ends
        self._before: dict[int, Any] = {}

    @uninterruptible
    def __enter__(self) -> Run:
        main = threading.current_thread() is threading.main_thread()
        self._run, self._outermost = current_run(), main and not _runs
        if not self._outermost:
            return self._run
        try:
            _runs.append(self._run)
            for number in SIGNALS:
                handler = signal.getsignal(number)
                if handler not in (signal.SIG_IGN, None):  # None is not Python's to restore
                    self._before[number] = handler
                    signal.signal(number, _stop)
            self._run.raise_pending()
        except BaseException:
            self._end()
            raise
        return self._run

    @uninterruptible
    def __exit__(self, kind: object, *_: object) -> None:
        try:
            with ExitStack() as stack:  # all of it, whatever fails
                for work in self._run.unfinished if self._outermost else ():
                    stack.callback(work)
        finally:
            self._end()
        try:
            self._run.raise_pending()
        except KeyboardInterrupt:
            if kind is None:  # or what ended the block stops the run as well
                raise

    def _end(self) -> None:
        try:
            self._restore()
        finally:  # handlers that are back may have interrupted it
            self._restore()

    def _restore(self) -> None:
        silent = self._process_ends and self._run.stopped_by is not None
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_IGN if silent else handler)
        if self._outermost:
            _runs.clear()


def _stop(number: int, frame: FrameType | None) -> None:
    run = current_run()
    if run.stopped_by is None:
        run.stopped_by = number
        run.pending = _is_uninterruptible(frame)
        if not run.pending:
            raise KeyboardInterrupt
    if run.unfinished:
        with suppress(OSError):  # a terminal that was closed
            os.write(STDERR, WAIT)


def announce(text: str) -> None:
    """Write a line to stderr at once, from any thread."""
    with suppress(OSError):
        os.write(STDERR, f"procam: {text}\n".encode(errors="replace"))


def _is_uninterruptible(frame: FrameType | None) -> bool:
    while frame and frame.f_code not in _uninterruptible:
        frame = frame.f_back
    return frame is not None
