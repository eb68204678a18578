"""One process at a time writes a venue, or lights its projectors."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from procam.errors import InputError
from procam.files.system import open_here, try_lock

NAME, MAX_NAME = ".lock", 100
LOCKED_AT = 2**20  # Windows locks bytes, which then cannot be read
_held: set[Path] = set()  # by this process


@contextmanager
def locked(venue_dir: Path, work: str) -> Iterator[None]:
    """Hold a venue's folder against other processes; inside another such block it changes nothing.

    `work` is what the refusal of another process calls this one, such as "capture".

    Raises
    ------
    InputError
        If another process holds it.
    OSError
        The file of the lock is a link, or may not be written.
    """
    folder = venue_dir.resolve()
    if folder in _held:
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / NAME, "a+", encoding="utf-8", errors="replace", opener=open_here) as file:
        file.seek(LOCKED_AT)
        if not try_lock(file):
            file.seek(0)
            raise InputError(
                f"{venue_dir}: {file.read(MAX_NAME) or 'another procam process'} is at work there; wait "
                "until it has ended, or stop it"
            )
        try:
            file.truncate(0)
            file.write(f"`procam {work}` (process {os.getpid()})")
            file.flush()
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(folder / NAME)) from error
        _held.add(folder)
        try:
            yield
        finally:
            _held.discard(folder)
