"""Calls that differ between operating systems: file locks, links, flushing to disk, pipe sizes, memory.

Linux and macOS have `fcntl` and `resource`, Windows has `msvcrt`. The rest of procam calls the
functions below and imports none of the three.
"""

import errno
import math
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

try:
    import fcntl
    import resource
except ImportError:  # Windows
    fcntl = resource = None  # type: ignore[assignment]

MAX_PIPE_BYTES = 2**20  # Linux's limit for ordinary users; the default is 64 KiB
NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)  # Windows has none


def try_lock(file: IO[Any]) -> bool:
    """Lock an open file against other processes; False if another holds it. Closing it unlocks it."""
    try:
        if fcntl:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            import msvcrt  # noqa: PLC0415

            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    except OSError:
        return False
    return True


def is_running(process: int) -> bool | None:
    """Whether a process of this computer is there, by its number; None on Windows, which cannot tell."""
    if not fcntl:
        return None  # os.kill would end it
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # of another user
        return True
    return True


def refuse_link(path: str | Path) -> None:
    """Raise the OSError of a link where a file of procam's own is needed.

    Whoever put it there chose its target, which procam would change or make.
    """
    if Path(path).is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))


def open_here(path: str, flags: int) -> int:
    """An opener for `open` that opens or makes `path` itself; a link there is refused."""
    refuse_link(path)
    return os.open(path, flags | NO_FOLLOW, 0o666)


def flush(path: Path) -> None:
    """Write a file or folder to disk; Windows cannot flush folders."""
    if not fcntl and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDONLY if fcntl else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def widen_pipe(descriptor: int, frame_bytes: int) -> None:
    """Raise the capacity of a pipe to one frame [bytes], within the system's limit.

    A large frame then passes in a third of the time. More capacity than a frame would add delay.
    Linux only; elsewhere, and for files that are no pipes, nothing changes.
    """
    wanted = min(frame_bytes, MAX_PIPE_BYTES)
    with suppress(AttributeError, OSError):
        if fcntl.fcntl(descriptor, fcntl.F_GETPIPE_SZ) < wanted:
            fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, wanted)


def peak_memory_mib() -> float:
    """Largest resident memory of this process so far [MiB]; NaN on Windows."""
    if not resource:
        return math.nan
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / unit
