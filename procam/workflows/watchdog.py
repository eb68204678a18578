"""A watchdog that owns darkness: it takes the light from a run as soon as it is not clearly allowed.

It asks on its own clock, in threads of its own, whatever the run is waiting for: a camera, a disk, the
answer of the interlock. An answer that is no, an error, or late makes all projectors dark at once and for
good. The run then ends by itself; one that does not is ended.
"""

import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, SimpleQueue
from typing import Self

from procam.devices.guard import Guard
from procam.devices.interrupts import SIGNALS, announce
from procam.errors import DeviceError, ProcamError
from procam.threads import Future, start

ASK_EVERY_S = 0.5
LATE_S = 2.0  # an answer after this is no
DARK_S = 1.0  # for all projectors to confirm that they are dark
AGAIN_S = 240.0  # for one that does not, such as a lamp that is warming up
END_S = 120.0  # for the run to end when its light is gone; lamps are switched off one by one
LOOK_S = 0.05  # for a signal while an answer is awaited
PRINT_S = 1.0  # for a line on stderr, which may be a pipe without a reader
Taken = Callable[[ProcamError, dict[str, str]], None]


class Stopped(DeviceError):
    """A signal stopped the run."""


def ask(
    question: Callable[[], None], late: str, is_over: Callable[[], bool] = lambda: False
) -> bool:
    """Ask whether projectors may be lit: a question that neither raises nor is late is a yes.

    Returns whether `is_over` became true before the answer; it is looked at every LOOK_S.

    Raises
    ------
    ProcamError
        What the question or `is_over` raised; `DeviceError` with the text `late` if there is no answer in
        LATE_S.
    """
    answer, deadline_s = start(question), time.monotonic() + LATE_S
    while time.monotonic() < deadline_s:
        with suppress(Empty):
            answer.result(LOOK_S)
            return False
        if is_over():
            return True
    raise DeviceError(late)


class Watchdog:
    """Watches a guarded rig from the beginning to the end of a block.

    Parameters
    ----------
    guard : takes the light.
    question, late : as of `ask`.
    give_up : called with the reason and the projectors that may be lit if the run does not end by itself.
    """

    def __init__(
        self, guard: Guard, question: Callable[[], None], late: str, give_up: Taken
    ) -> None:
        self._guard, self._question, self._late, self._give_up = guard, question, late, give_up
        # a signal's number, or 0 when the rig is left
        self._calls: SimpleQueue[int] = SimpleQueue()
        self._left = False
        self._watching: Future[None] | None = None

    def __enter__(self) -> Self:
        self._signals = _Signals(self._calls)
        self._watching = start(self._watch)
        return self

    def __exit__(self, *_: object) -> None:
        self._signals.end()
        self._calls.put(0)
        if self._watching is not None:
            with suppress(Empty):
                self._watching.result(LATE_S)

    def _watch(self) -> None:
        why = self._first_no()
        if why is None:
            return
        lit = self._guard.close(why, DARK_S)
        deadline_s = time.monotonic() + AGAIN_S
        if not self._wait(PRINT_S):
            print_line(f"{why}; {state_in_words(lit)}; waiting for the run to end")
        while lit and time.monotonic() < deadline_s and not self._left:
            lit = self._guard.close(why, DARK_S)
            self._wait(ASK_EVERY_S)
        if not self._wait(END_S):
            self._give_up(why, lit)

    def _first_no(self) -> ProcamError | None:
        """Why the light must go; None if the rig is left before."""
        while True:
            asked_s = time.monotonic()
            try:
                if ask(self._question, self._late, partial(self._wait, 0.0)):
                    return None
                if self._wait(asked_s + ASK_EVERY_S - time.monotonic()):
                    return None
            except ProcamError as error:
                return error
            except BaseException as error:
                return DeviceError(f"the interlock could not be asked ({error})")

    def _wait(self, duration_s: float) -> bool:
        """Wait for a while; whether the rig is left. A signal is an error, unless the light is gone."""
        deadline_s = time.monotonic() + duration_s
        with suppress(Empty):
            while not self._left:
                number = self._calls.get(timeout=max(0.0, deadline_s - time.monotonic()))
                self._left = not number
                if number and self._guard.closed is None:
                    raise Stopped(f"stopped by {signal.Signals(number).name}")
        return self._left


class _Signals:
    """Puts the numbers of signals into a queue, also while the main thread is in a call that ignores them.

    Only for a block in the main thread, which alone may ask for it.
    """

    def __init__(self, calls: SimpleQueue[int]) -> None:
        self._calls = calls
        self._before: int | None = None
        if threading.current_thread() is threading.main_thread():
            reader, self._writer = os.pipe()
            os.set_blocking(self._writer, False)
            self._before = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
            start(partial(self._forward, reader))

    def end(self) -> None:
        """Restore what was before."""
        if self._before is not None:
            signal.set_wakeup_fd(self._before)
            self._before = None
            os.close(self._writer)

    def _forward(self, reader: int) -> None:
        while numbers := os.read(reader, 16):
            for number in SIGNALS:
                if number in numbers:
                    self._calls.put(number)
        os.close(reader)


def state_in_words(lit: dict[str, str]) -> str:
    """What is known about the light."""
    named = ", ".join(f"{name} ({why})" for name, why in lit.items())
    return f"a projector may still be lit: {named}" if lit else "all projectors are dark"


def print_line(text: str) -> None:
    """Write a line to stderr, which may be a pipe without a reader."""
    with suppress(Empty, RuntimeError):  # or a system that starts no more threads
        start(partial(announce, text)).result(PRINT_S)
