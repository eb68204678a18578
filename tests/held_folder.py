"""A folder that another process is at work on."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

HOLD = """
import sys
from pathlib import Path
from procam.files.lock import locked
with locked(Path(sys.argv[1]), sys.argv[2]):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def held_by(command: str, folder: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """As by `procam COMMAND`; the process is killed at the end."""
    program = [sys.executable, "-c", HOLD, str(folder), command]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout and process.stdout.readline() == b"held\n"
        yield process
        process.kill()
