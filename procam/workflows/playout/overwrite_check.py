"""Checks before a run begins that it writes nothing over what it reads, and nothing twice."""

from collections.abc import Iterable
from functools import cache
from pathlib import Path

from procam.errors import InputError

Named = tuple[str, Path]  # the argument that asks for a file, and the file


def refuse_overwriting(read: Iterable[Path], written: Iterable[Named]) -> None:
    """Refuse a run that would write over what it reads, or over what it has written itself.

    Files are the same if they have one place, whatever it is called, or are one file on the disk.

    Raises
    ------
    InputError
        The first that would be written over.
    """
    resolved = cache(Path.resolve)  # folders: there are few of them, of files there are many

    def marks(path: Path) -> list[object]:
        place: object = (resolved(path.parent), path.name)
        try:
            stat = path.stat()
        except OSError:  # it is not there yet
            return [place]
        return [place, (stat.st_dev, stat.st_ino)]

    taken: dict[object, str] = {mark: "IN itself" for path in read for mark in marks(path)}
    for argument, path in written:
        found = marks(path)
        owner = next((taken[mark] for mark in found if mark in taken), None)
        if owner:
            raise InputError(f"{argument}: {path} is {owner}; choose another name")
        taken |= dict.fromkeys(found, f"a file that {argument} writes already")
