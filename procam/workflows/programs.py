"""Programs that venue.toml names: they get a time limit, and nothing that they do harms the run."""

import os
import subprocess
import time
from contextlib import suppress
from functools import partial
from queue import Empty

from procam.threads import start

SHOWN = 200  # letters of what a program printed
START_S = 0.5  # more, for a program whose file is on a disk that hangs
POLL_S = 0.01
PIPE_BYTES = 1 << 16


def run_program(words: list[str], limit_s: float) -> tuple[int | None, str]:
    """Exit code of a program, None if it did not end in time, and what it printed, in brackets.

    The program is started in a session of its own, so that the signals of a terminal do not reach it.

    Raises
    ------
    OSError
        It cannot be started, or its exit code is lost.
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
        os.set_blocking(output.fileno(), False)  # a child of its own may hold the other end
        printed, deadline_s = b"", time.monotonic() + limit_s
        while (code := _exit_code(process)) is None and time.monotonic() < deadline_s:
            printed = (printed + _read(output.fileno()))[:PIPE_BYTES]
            time.sleep(POLL_S)
        if code is None:
            _kill(process)
            return None, ""
        return code, _shown(printed + _read(output.fileno()))


def _read(pipe: int) -> bytes:
    """What is in a pipe, so that a program that prints a lot does not wait for its reader."""
    with suppress(BlockingIOError):
        return os.read(pipe, PIPE_BYTES)
    return b""


def _exit_code(process: subprocess.Popen[bytes]) -> int | None:
    """Exit code of a program; None if it did not end yet.

    `Popen.wait` returns 0 for a program whose exit code is lost, as where SIGCHLD is ignored: a no of an
    interlock would be a yes.
    """
    try:
        found, status = os.waitpid(process.pid, os.WNOHANG)
    except ChildProcessError as error:
        process.returncode = -1  # nothing is left to wait for
        raise OSError(error.errno, "its exit code is lost") from error
    if not found:
        return None
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode


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
