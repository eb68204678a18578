"""Programs that venue.toml names: they get a time limit, and nothing that they do harms the run."""

import os
import subprocess
from contextlib import suppress
from functools import partial
from queue import Empty

from procam.threads import start

SHOWN = 200  # letters of what a program printed
START_S = 0.5  # more, for a program whose file is on a disk that hangs


def run_program(words: list[str], limit_s: float) -> tuple[int | None, str]:
    """Exit code of a program, None if it did not end in time, and what it printed, in brackets.

    The program is started in a session of its own, so that the signals of a terminal do not reach it.

    Raises
    ------
    OSError
        It cannot be started.
    """
    future = start(partial(_run, words, limit_s))
    try:
        return future.result(limit_s + START_S)
    except Empty:
        return None, ""


def _run(words: list[str], limit_s: float) -> tuple[int | None, str]:
    process = subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    assert process.stdout is not None
    with process.stdout as output:
        try:
            code = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            _kill(process)
            return None, ""
        os.set_blocking(output.fileno(), False)  # a child of its own may hold the other end
        return code, _shown(output.read() or b"")


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a program and its children."""
    with suppress(OSError):
        os.killpg(process.pid, 9)
    with suppress(subprocess.TimeoutExpired):
        process.wait(START_S)


def _shown(printed: bytes) -> str:
    text = " ".join(printed.decode(errors="replace").split())[:SHOWN]
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    return f" ({text})" if text else ""
