"""The list of commands, and how errors end the process."""

import errno
import inspect
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest
from tiny_venue import procam

from procam.errors import DeviceError, InputError
from procam.interfaces.cli import main
from procam.interfaces.cli.main import COMMANDS, load_command


def _function(name: str) -> Callable[..., None]:
    module = import_module(f"procam.interfaces.cli.{name.replace(' ', '.')}")
    function: Callable[..., None] = getattr(module, name.rsplit(maxsplit=1)[-1])
    return function


@pytest.mark.parametrize("name", COMMANDS)
def test_the_line_of_the_list_is_the_first_line_of_the_commands_help(name: str) -> None:
    assert str(inspect.getdoc(_function(name))).splitlines()[0] == COMMANDS[name]


@pytest.mark.parametrize("name", COMMANDS)
def test_no_word_of_the_help_is_taken_for_markup(name: str) -> None:
    """A table of venue.toml in square brackets would not be shown."""
    command = load_command(name)
    texts = [command.help, *(getattr(option, "help", "") for option in command.params)]
    hidden = re.compile(r"(?<!\\)\[(?!default)[a-z_./]+\]")
    assert [text for text in texts if text and hidden.search(text)] == []


def test_every_module_without_an_underscore_is_a_command() -> None:
    folder = Path(main.__file__).parent
    modules = {
        " ".join(path.relative_to(folder).with_suffix("").parts)
        for path in folder.rglob("[a-z]*.py")
    }
    assert modules == {*COMMANDS, "main"}


def test_a_misspelt_command_gets_a_suggestion() -> None:
    ran = procam("calibrat")
    assert (ran.code, "'calibrate'" in ran.err) == (2, True)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (InputError("size: 0 px"), 2, "procam: size: 0 px"),
        (DeviceError("camera zenith: no answer"), 1, "procam: camera zenith: no answer"),
        (OSError(errno.ENOSPC, "full"), 2, "procam: disk: the disk is full"),
    ],
)
def test_an_error_is_one_line(error: Exception, code: int, words: str) -> None:
    def fail() -> None:
        raise error

    ran = procam("demo", command=fail)
    assert ran.code == code
    assert ran.complaint.startswith(words)


def test_a_signal_that_a_library_turns_into_another_error_still_stops() -> None:
    def load() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)  # to this thread, of several
        except KeyboardInterrupt as stop:
            raise ImportError("initialization failed") from stop

    ran = procam("demo", command=load)
    assert ran.code == 128 + signal.SIGTERM
    assert "procam: stopped (ImportError: initialization failed). Run the same" in ran.err


def test_what_was_printed_arrives_although_a_thread_is_still_running() -> None:
    """As when Ctrl-C comes while it is waited for: the process ends at once."""
    code = """import time
from procam.interfaces.cli.main import _end
from procam.threads import start
start(lambda: time.sleep(60))
print("south is dark")
_end("stopped", 130)
"""
    buffered = {n: value for n, value in os.environ.items() if n != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, env=buffered, capture_output=True, text=True, check=False, timeout=30
    )
    assert (done.returncode, done.stdout) == (130, "south is dark\n")
    assert done.stderr == "procam: stopped\n"
