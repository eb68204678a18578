"""Numbered pictures: sky.%04d.exr, sky.####.exr, or a folder of them; and the log of what is made."""

import json
import math
import os
import re
import threading
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, BinaryIO

from procam.errors import FileFormatError, InputError
from procam.files.atomic import read_lines
from procam.files.images.images import SUFFIXES

PRINTF = re.compile(r"%(?:0?(\d+))?d")
HASHES = re.compile(r"#+")
LAST_NUMBER = re.compile(r"(.*?)(\d+)(\D*)")
TOLD = 8  # missing numbers that a message lists


@dataclass(frozen=True, slots=True)
class Numbered:
    """How the pictures of a sequence are named: FOLDER/BEFORE0001AFTER.

    >>> Numbered(Path("in"), "sky.", 4, ".exr").path(12).name
    'sky.0012.exr'
    """

    folder: Path
    before: str
    digits: int
    after: str

    def path(self, number: int) -> Path:
        """The picture of a number."""
        return self.folder / f"{self.before}{number:0{self.digits}d}{self.after}"

    @property
    def suffix(self) -> str:
        """Of every picture."""
        return Path(f"x{self.after}").suffix

    def __str__(self) -> str:
        return str(self.folder / f"{self.before}{'#' * self.digits}{self.after}")

    def number_of(self, name: str) -> int | None:
        """The number in a file's name; None where the name is not of this sequence."""
        start, end = len(self.before), len(name) - len(self.after)
        number = name[start:end]
        fits = name.startswith(self.before) and name.endswith(self.after) and number.isdecimal()
        if not fits or number != f"{int(number):0{self.digits}d}":
            return None
        return int(number)


@dataclass(frozen=True, slots=True)
class PictureSequence:
    """Pictures that are there, by rising number with one step between all."""

    names: Numbered
    numbers: tuple[int, ...]


def parse_pattern(path: Path) -> Numbered | None:
    """What sky.%04d.exr or sky.####.exr means; None for a name without such a place.

    >>> parse_pattern(Path("sky.%04d.exr")) == parse_pattern(Path("sky.####.exr"))
    True
    """
    found = [*PRINTF.finditer(path.name), *HASHES.finditer(path.name)]
    if not found:
        return None
    if len(found) > 1:
        raise InputError(f"{path}: got {len(found)} places for a number, expected one")
    place = found[0]
    digits = len(place[0]) if place[0].startswith("#") else int(place[1] or 1)
    return Numbered(path.parent, path.name[: place.start()], digits, path.name[place.end() :])


def find_sequence(path: Path) -> PictureSequence | None:
    """The sequence that a pattern or a folder names; None if `path` is neither.

    Raises
    ------
    FileFormatError
        No picture; several sequences in one folder; numbers that are missing.
    """
    if path.is_dir():
        names = _names_in(path)
    else:
        found = parse_pattern(path)
        if found is None:
            return None
        names = found
    present = (names.number_of(file.name) for file in _files(names.folder))
    numbers = sorted(number for number in present if number is not None)
    if not numbers:
        raise FileFormatError(f"{path}: got no picture of that name, expected numbered pictures")
    _refuse_gaps(names, numbers)
    return PictureSequence(names, tuple(numbers))


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: got no such folder, expected numbered pictures in it")
    return [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]


def _names_in(folder: Path) -> Numbered:
    """How the numbered pictures of a folder are named."""
    found: dict[tuple[str, str], list[str]] = {}
    for file in _files(folder):
        match = LAST_NUMBER.fullmatch(file.stem)
        if match and file.suffix in SUFFIXES:
            found.setdefault((match[1], match[3] + file.suffix), []).append(match[2])
    if len(found) != 1:
        named = ", ".join(sorted(f"{before}#{after}" for before, after in found)) or "none"
        raise FileFormatError(
            f"{folder}: got {named}, expected the numbered pictures of one sequence; name one by a "
            "pattern such as sky.%04d.exr"
        )
    ((before, after), numbers) = found.popitem()
    names = Numbered(folder, before, min(len(number) for number in numbers), after)
    padded = [
        name for n in sorted(numbers) if names.number_of(name := f"{before}{n}{after}") is None
    ]
    if padded:
        shortest = f"{before}{min(numbers, key=len)}{after}"
        raise FileFormatError(
            f"{folder}: got {shortest} and {padded[0]}, expected one padding for all numbers; rename "
            "some, or name some by a pattern such as sky.%04d.exr"
        )
    return names


def _refuse_gaps(names: Numbered, numbers: list[int]) -> None:
    step = math.gcd(*(b - a for a, b in pairwise(numbers))) or 1
    missing = (numbers[-1] - numbers[0]) // step + 1 - len(numbers)
    if not missing:
        return
    each = (n for a, b in pairwise(numbers) for n in range(a + step, b, step))
    listed = ", ".join(names.path(n).name for n in islice(each, TOLD))
    more = f" and {missing - TOLD} more" if missing > TOLD else ""
    raise FileFormatError(
        f"{names}: got a gap in the numbering, {listed}{more} missing, expected every picture from "
        f"{names.path(numbers[0]).name} to {names.path(numbers[-1]).name}; render them again"
    )


class MadeLog:
    """What a run has made, a line of JSON per file beside the files, so that a killed run resumes.

    A line holds the output's name and size, the source's size and time, a key of all that went into
    it, and whatever else a run wants back.

    Parameters
    ----------
    path : of the log. key : of the calibration, the settings and the program.
    """

    def __init__(self, path: Path, key: str) -> None:
        self.path, self._key = path, key
        self._lock = threading.Lock()
        self._lines: dict[str, dict[str, Any]] = {}
        for line in read_lines(path):
            entry = _entry(line)
            self._lines[str(entry.get("out"))] = entry

    def made(self, out: Path, source: list[int]) -> dict[str, Any] | None:
        """What was logged of an output that is still there, whole and of today's source."""
        entry = self._lines.get(out.name)
        if entry is None or entry.get("key") != self._key or not out.is_file():
            return None
        same = entry.get("size") == out.stat().st_size and entry.get("source") == source
        return entry["kept"] if same else None

    def add(self, out: Path, source: list[int], kept: dict[str, Any]) -> None:
        """Log an output that is written, durably; `source` is what `state_of` told before it was read."""
        entry = {
            "out": out.name,
            "size": out.stat().st_size,
            "source": source,
            "key": self._key,
            "kept": kept,
        }
        line = json.dumps(entry).encode() + b"\n"
        with self._lock, self.path.open("ab+") as file:
            if file.tell() and not _ends_whole(file):
                file.write(b"\n")  # after a line that a kill tore
            file.write(line)
            file.flush()
            os.fsync(file.fileno())


def _ends_whole(file: BinaryIO) -> bool:
    file.seek(-1, os.SEEK_END)
    return file.read() == b"\n"


def _entry(line: str) -> dict[str, Any]:
    """A line of the log; one that was torn tells nothing, so that its file is made again."""
    try:
        found = json.loads(line)
    except json.JSONDecodeError:
        return {}
    return found if isinstance(found, dict) else {}


def state_of(source: Path) -> list[int]:
    """Size [byte] and time [ns] of a file: another state is another content."""
    stat = source.stat()
    return [stat.st_size, stat.st_mtime_ns]
