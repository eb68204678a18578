"""Signals that stop a run: Ctrl-C, TERM and HUP (a closed terminal) alike, and only the first of them.

Projectors must be dark afterwards, so what makes them dark is not interrupted a second time.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field

SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
STDERR = 2  # sys.stderr may be no file, as in a notebook
WAIT = b"procam: stopping; projectors are being made dark, please wait\n"


@dataclass
class Run:
    """What happened between the begin and the end of `interruptible`.

    Attributes
    ----------
    stopped_by : number of the first signal; None if there was none.
    unfinished : what must still be done before the process may end, such as darkening a rig.
    left_dark : whether a rig was used, and all of its projectors are confirmed to be dark.
    """

    stopped_by: int | None = None
    unfinished: list[Callable[[], None]] = field(default_factory=list)
    left_dark: bool = False


_runs: list[Run] = []  # the present one, or none


def current_run() -> Run:
    """The run that `interruptible` began; outside of one, a new one that nobody looks at."""
    return _runs[0] if _runs else Run()


@contextmanager
def interruptible(process_ends: bool = False) -> Iterator[Run]:
    """A block in which the first of `SIGNALS` raises KeyboardInterrupt, and all others are ignored.

    At its end it does what is `unfinished`. If a signal came and the process ends with the block, further
    ones stay ignored, so that it can say what it has done. Inside another such block, and outside the
    main thread, where Python allows no handlers, it changes nothing. A signal that is ignored already
    (nohup) stays ignored.
    """
    if _runs or threading.current_thread() is not threading.main_thread():
        yield current_run()
        return
    run = Run()
    _runs.append(run)
    heeded = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _stop) for number in heeded}
    try:
        try:
            yield run
        finally:
            while run.unfinished:
                run.unfinished.pop()()
    finally:
        silent = process_ends and run.stopped_by is not None
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if silent else handler)
        _runs.clear()


def _stop(number: int, _: object) -> None:
    run = current_run()
    if run.stopped_by is not None:
        if run.unfinished:
            with suppress(OSError):  # a terminal that was closed
                os.write(STDERR, WAIT)
        return
    run.stopped_by = number
    raise KeyboardInterrupt
