"""Signals at awkward moments: the first one stops, none leaves a projector lit."""

import io
import os
import signal
import sys
import threading
from contextlib import nullcontext, suppress
from types import SimpleNamespace

import numpy as np
import pytest
from every_instruction import interrupted

from procam.devices import interrupts
from procam.devices.interrupts import SIGNALS, current_run, interruptible
from procam.devices.rig import Rig
from procam.errors import DeviceError
from procam.threads import start

STUCK_S = 120.0


class Projector:
    """Lit from the start; `show` first runs what is due, such as a signal."""

    size = (4, 3)

    def __init__(self) -> None:
        self.lit, self.due = True, list[int]()

    def show(self, drive: np.ndarray) -> None:
        while self.due:
            os.kill(os.getpid(), self.due.pop(0))
        self.lit = bool(drive.any())


class Broken(Projector):
    """Does what is due, and is gone."""

    def show(self, drive: np.ndarray) -> None:
        super().show(drive)
        raise OSError("no such device")


@pytest.fixture(autouse=True)
def handlers() -> None:
    """Python's own for Ctrl-C, and for the others one that a test would notice."""
    for number in SIGNALS:
        signal.signal(number, signal.default_int_handler)


def rig_of(*projectors: Projector) -> Rig:
    clock = SimpleNamespace(now_s=lambda: 0.0, sleep=lambda _: None)
    return Rig({}, {f"p{i}": p for i, p in enumerate(projectors)}, {}, clock)  # type: ignore[arg-type]


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_signal_stops_and_the_others_are_ignored(number: int) -> None:
    projector = Projector()
    projector.due = 5 * [number]  # while it is made dark
    with pytest.raises(KeyboardInterrupt), interruptible() as run, rig_of(projector):
        os.kill(os.getpid(), number)
    assert not projector.lit
    assert (run.stopped_by, run.left_dark, run.unfinished) == (number, True, [])
    assert signal.getsignal(number) is signal.default_int_handler


@pytest.mark.parametrize("number", SIGNALS)
def test_a_first_signal_while_projectors_are_made_dark(number: int) -> None:
    first, second = Projector(), Projector()
    first.due = 5 * [number]
    with pytest.raises(KeyboardInterrupt), interruptible() as run, rig_of(first, second):
        pass
    assert not first.lit and not second.lit and run.left_dark


def test_a_rig_whose_end_was_never_reached_is_made_dark() -> None:
    """As if the signal had come between the block and its end."""
    projector = Projector()
    with pytest.raises(KeyboardInterrupt), interruptible() as run:
        rig_of(projector).__enter__()
        os.kill(os.getpid(), signal.SIGINT)
    assert not projector.lit and run.left_dark


def test_without_a_run_a_rig_minds_signals_itself() -> None:
    """As from a script or a notebook."""
    projector = Projector()
    with pytest.raises(KeyboardInterrupt), rig_of(projector):
        projector.due = [signal.SIGINT]
        os.kill(os.getpid(), signal.SIGINT)
    assert not projector.lit
    assert current_run().stopped_by is None


@pytest.mark.parametrize("in_a_run", [True, False])
def test_a_signal_at_any_instruction_leaves_projectors_dark_and_handlers_as_they_were(
    in_a_run: bool,
) -> None:
    projector, tried, stopped, late = Projector(), 0, 0, 0
    entered, early = False, False

    def light() -> None:
        nonlocal entered
        with interruptible() if in_a_run else nullcontext(), rig_of(projector):
            projector.lit = entered = True

    def stop() -> None:
        nonlocal early
        early = not entered
        os.kill(os.getpid(), signal.SIGINT)

    more = True
    while more:
        tried += 1
        entered = early = projector.lit = False
        try:
            more = interrupted(light, tried, stop, "procam/devices")
        except KeyboardInterrupt:
            stopped += 1
        late += entered and early
        assert not projector.lit
        assert current_run() is not current_run()  # no run goes on
        assert all(signal.getsignal(n) is signal.default_int_handler for n in SIGNALS)
    assert stopped == tried - 1 > 100
    assert late <= 8  # after `raise_pending`, where Python raises nothing


def test_the_second_signal_interrupts_nothing_else_that_ends() -> None:
    ended = False
    with pytest.raises(KeyboardInterrupt), interruptible() as run:
        try:
            os.kill(os.getpid(), signal.SIGINT)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            ended = True
    assert ended and run.stopped_by == signal.SIGINT


@pytest.mark.parametrize("failed", [DeviceError("camera failed"), GeneratorExit()])
def test_a_signal_while_a_failed_run_is_made_dark_stops_it_at_once(failed: BaseException) -> None:
    """And does not disturb what is done after that, such as switching lamps off."""
    first, lamps = Projector(), Projector()
    with interruptible() as run:
        with pytest.raises(KeyboardInterrupt), rig_of(first):
            first.due = [signal.SIGTERM]
            raise failed
        with rig_of(lamps):
            switched_off = True
    assert switched_off and not first.lit and run.stopped_by == signal.SIGTERM


def test_a_rig_may_be_used_again_also_within_itself() -> None:
    projector = Projector()
    rig = rig_of(projector)
    with rig, rig:
        pass
    assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler
    with pytest.raises(KeyboardInterrupt), interruptible() as run:
        with rig:
            pass
        projector.lit = True
        with rig:
            os.kill(os.getpid(), signal.SIGTERM)
    assert not projector.lit and run.left_dark


@pytest.mark.parametrize("fails", [False, True])
def test_a_signal_is_neither_raised_nor_lost_in_another_thread(fails: bool) -> None:
    """Which makes its own rig dark while the main one does."""
    projector, other, ended = Projector(), Projector(), list[bool]()
    may_end = threading.Event()

    def broken(_: np.ndarray) -> None:
        raise OSError("no such device")

    def beside() -> bool:
        with pytest.raises(DeviceError) if fails else nullcontext(), rig_of(other):
            assert may_end.wait(STUCK_S)
            if fails:
                other.show = broken  # type: ignore[method-assign]
        return True

    with pytest.raises(KeyboardInterrupt), interruptible(), rig_of(projector):
        future = start(beside)
        show = projector.show

        def after_the_signal(drive: np.ndarray) -> None:
            projector.show = show  # type: ignore[method-assign]
            os.kill(os.getpid(), signal.SIGINT)
            may_end.set()
            ended.append(future.result())
            show(drive)

        projector.show = after_the_signal  # type: ignore[method-assign]
    assert ended and not projector.lit and other.lit == fails


def test_all_rigs_are_made_dark_whatever_fails() -> None:
    good = Projector()
    with pytest.raises(DeviceError, match="may still be lit"), interruptible():
        rig_of(good).__enter__()
        rig_of(Broken()).__enter__()
    assert not good.lit


def test_a_handler_that_is_not_python_s_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """It could not be restored."""
    known = signal.getsignal
    monkeypatch.setattr(signal, "getsignal", lambda n: None if n == signal.SIGHUP else known(n))
    with interruptible():
        monkeypatch.undo()
        assert signal.getsignal(signal.SIGHUP) is signal.default_int_handler
        assert signal.getsignal(signal.SIGTERM) is interrupts._stop


def test_a_projector_that_does_not_answer_is_named_and_nothing_is_called_dark() -> None:
    good = Projector()
    with pytest.raises(Exception, match=r"may still be lit: p0 \(no such device\); close"):
        with interruptible() as run, rig_of(Broken(), good):
            pass
    assert not good.lit and not run.left_dark


def test_a_rig_that_is_dark_does_not_make_another_one_dark() -> None:
    with interruptible() as run:
        assert not run.left_dark  # none was used
        with pytest.raises(DeviceError), rig_of(Broken()):
            pass
        with rig_of(Projector()):
            assert not run.left_dark
        assert not run.left_dark


def test_a_rig_that_fails_at_the_very_end_leaves_no_signal_ignored() -> None:
    """In a notebook the next run must be one that Ctrl-C stops."""

    broken = Broken()
    broken.due = [signal.SIGINT]
    with (
        pytest.raises(DeviceError, match=r"may still be lit: p0 \(no such device\)"),
        rig_of(broken),
    ):
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with interruptible() as run:
        assert run.stopped_by is None and run is current_run()
        broken.due, may_go_on = [signal.SIGINT], False
        with pytest.raises(DeviceError), rig_of(broken):
            pass
        with suppress(KeyboardInterrupt), rig_of(Projector()):
            may_go_on = True
    assert may_go_on and run.stopped_by == signal.SIGINT


def test_further_signals_do_no_harm_where_stderr_is_no_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setattr(interrupts, "STDERR", -1)
    projector = Projector()
    projector.due = [signal.SIGINT]
    with pytest.raises(KeyboardInterrupt), interruptible() as run, rig_of(projector):
        os.kill(os.getpid(), signal.SIGINT)
    assert not projector.lit and run.left_dark


def test_an_ending_process_stays_deaf_once_it_was_stopped() -> None:
    with pytest.raises(KeyboardInterrupt), interruptible(process_ends=True):
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


def test_nohup_is_respected() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with interruptible() as run:
        os.kill(os.getpid(), signal.SIGHUP)
    assert run.stopped_by is None
