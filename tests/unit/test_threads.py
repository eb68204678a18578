"""Threads beside the main one: order, errors, ends; and Ctrl-C at every single instruction."""

import gc
import threading
import time
import weakref
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from every_instruction import interrupted

from procam.threads import ThreadPool, any_running, start
from procam.workflows.capture.capture import _Recorder
from procam.workflows.playout.pipeline import ThreadPlan, flow

STUCK_S = 120.0
Work = Callable[[], object]


def ends_in_time(work: Work, instruction: int) -> bool:
    """Whether work was interrupted there; that it ends, and by nothing else, is asserted."""
    more, raised = [True], list[type]()

    def caller() -> None:
        try:
            more[0] = interrupted(work, instruction, ctrl_c)
        except BaseException as error:
            raised.append(type(error))

    thread = threading.Thread(target=caller, daemon=True)
    thread.start()
    thread.join(STUCK_S)
    assert not thread.is_alive(), f"waits for ever after Ctrl-C at instruction {instruction}"
    assert raised in ([], [KeyboardInterrupt])
    return more[0]


def ctrl_c() -> None:
    raise KeyboardInterrupt


def mapped() -> None:
    with ThreadPool(2) as pool:
        assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]


def alone() -> None:
    assert start(lambda: 7).result() == 7


class Written:
    """A session that takes a moment to store a frame, and a rig that is dark."""

    directory = "nowhere"

    def darken_all(self) -> list[str]:
        return []

    def store(self, *_: object) -> None:
        time.sleep(1e-4)


def recorded() -> None:
    both = Written()
    with _Recorder(both, both) as recorder:  # type: ignore[arg-type]
        for shot in range(2):
            recorder.store("main", shot, 0.1, None)  # type: ignore[arg-type]


def flowed() -> None:
    reads = [partial(int, text) for text in "123"]
    assert list(flow(reads, lambda n: partial(abs, n), ThreadPlan(1, 1))) == [1, 2, 3]


@pytest.mark.parametrize("work", [mapped, alone, recorded, flowed])
def test_ctrl_c_at_any_instruction_ends_in_time(work: Work) -> None:
    tried = 1
    while ends_in_time(work, tried):
        tried += 1
    assert tried > 50


def test_what_goes_wrong_in_a_thread_is_raised_where_it_is_asked_for() -> None:
    with ThreadPool(1) as pool:
        bad, good = pool.submit(lambda: int("bad")), pool.submit(lambda: 3)
        assert good.result() == 3
        assert bad.done()
        with pytest.raises(ValueError, match="bad"):
            bad.result()


def test_the_end_waits_for_what_runs_and_starts_nothing_else() -> None:
    began, may_end, did = threading.Event(), threading.Event(), list[int]()

    def slow() -> None:
        began.set()
        assert may_end.wait(STUCK_S)
        did.append(1)

    def end() -> None:
        while not pool._stopped:
            time.sleep(1e-3)
        may_end.set()

    with ThreadPool(1) as pool:
        pool.submit(slow)
        never = pool.submit(lambda: did.append(2))
        assert began.wait(STUCK_S)
        assert any_running()
        start(end)
    assert did == [1]
    for late in (never.result, lambda: pool.submit(end)):
        with pytest.raises(RuntimeError, match="not started: the pool of threads has ended"):
            late()
    assert not any_running()


def test_a_thread_runs_from_its_start_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Although it may get its turn later."""
    monkeypatch.setattr("procam.threads._thread.start_new_thread", lambda run, given: None)
    future = start(lambda: 1)
    assert any_running()
    future.run(lambda: 2)
    assert not any_running()


def test_patience_is_for_each_thread() -> None:
    """One that waits at a pipe must not keep the end from the others."""
    began, stuck, did = threading.Event(), threading.Event(), list[int]()

    def slow() -> None:
        began.set()
        time.sleep(1.5)  # the end waits a second for the one that is stuck, and another for this
        did.append(1)

    with ThreadPool(2, patience_s=1.0) as pool:
        pool.submit(lambda: stuck.wait(STUCK_S))
        pool.submit(slow)
        assert began.wait(STUCK_S)
    assert did == [1]
    assert any_running()
    stuck.set()


def test_what_failed_is_freed_at_once() -> None:
    frame = np.zeros(3)
    held = weakref.ref(frame)

    def fail(frame: np.ndarray) -> None:
        raise ValueError

    gc.disable()
    try:
        future = start(partial(fail, frame))
        with pytest.raises(ValueError):
            future.result()
        del frame
        assert held() is None
    finally:
        gc.enable()
