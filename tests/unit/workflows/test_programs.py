"""Programs get a time limit, and whatever they do, there is an answer."""

import os
import signal
import subprocess
import sys
import time

import pytest

from procam.workflows.programs import SHOWN, run_program

LIMIT_S = 5.0


def test_exit_code_and_what_was_printed() -> None:
    assert run_program(["true"], LIMIT_S) == (0, "")
    code, printed = run_program(
        [sys.executable, "-c", "print('door\\n is \\x1b open'); exit(3)"], LIMIT_S
    )
    assert (code, printed) == (3, " (door is ? open)")


def test_a_signal_is_no_success() -> None:
    assert run_program(["sh", "-c", "kill -9 $$"], LIMIT_S)[0] == -9


@pytest.mark.parametrize("script", ["sleep 60", "trap '' TERM; sleep 60 & wait", "yes"])
def test_one_that_does_not_end_has_no_answer(script: str) -> None:
    began = time.monotonic()
    assert run_program(["sh", "-c", script], 0.2) == (None, "")
    assert time.monotonic() - began < LIMIT_S


def test_a_child_that_holds_the_output_is_not_waited_for() -> None:
    began = time.monotonic()
    assert run_program(["sh", "-c", "sleep 60 & echo yes"], LIMIT_S) == (0, " (yes)")
    assert time.monotonic() - began < LIMIT_S


def test_long_texts_are_cut() -> None:
    """And do not fill the pipe, at which a program would wait."""
    code, printed = run_program(["sh", "-c", "yes | head -c 300000"], LIMIT_S)
    assert code == 0 and len(printed) == SHOWN + len(" ()")


def test_one_that_is_not_there() -> None:
    with pytest.raises(OSError, match="no-such"):
        run_program(["/no-such-program"], LIMIT_S)


@pytest.mark.parametrize("script", ["exit 1", "sleep 0.2; exit 1", "exit 0"])
def test_an_exit_code_that_is_lost_is_no_success(script: str) -> None:
    """Whoever started procam may have ignored SIGCHLD, which it inherits."""
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        with pytest.raises(OSError, match="its exit code is lost"):
            run_program(["sh", "-c", script], LIMIT_S)
    finally:
        signal.signal(signal.SIGCHLD, before)


COMPUTING = """
import threading, time
import numpy as np
from procam.workflows.programs import run_program

def ask():
    while time.monotonic() < end_s:
        assert run_program(["true"], 2.0) == (0, "")

end_s, some = time.monotonic() + 2.0, np.ones((400, 400))
asking = threading.Thread(target=ask, daemon=True)
asking.start()
while time.monotonic() < end_s:
    some @ some
asking.join()
"""


def test_a_run_that_computes_is_not_disturbed() -> None:
    """A fork would run the handlers of the linear algebra's threads, which then wait for ever."""
    several = {**os.environ, "OPENBLAS_NUM_THREADS": "2"}
    subprocess.run([sys.executable, "-c", COMPUTING], env=several, timeout=60, check=True)
