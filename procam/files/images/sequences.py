"""Numbered pictures: sky.%04d.exr, sky.####.exr, or a folder of them."""

import math
import re
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path

from procam.errors import FileFormatError, InputError
from procam.files.images.pixels import SUFFIXES

PRINTF = re.compile(r"%(?:0?(\d+))?d")
HASHES = re.compile(r"#+")
LAST_NUMBER = re.compile(r"(.*?)(\d+)(\D*)")
MOST_DIGITS = 12  # of a number in a name
MAX_LISTED = 8  # missing numbers that a message lists


@dataclass(frozen=True, slots=True)
class Numbered:
    """The naming scheme of a sequence: FOLDER/BEFORE0001AFTER.

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
        """Suffix of every picture."""
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
    """The pictures of a sequence; their numbers rise by a constant step."""

    names: Numbered
    numbers: tuple[int, ...]


def parse_pattern(path: Path) -> Numbered | None:
    """The naming scheme that sky.%04d.exr or sky.####.exr describes; None for a name without a number.

    >>> parse_pattern(Path("sky.%04d.exr")) == parse_pattern(Path("sky.####.exr"))
    True
    """
    found = [*PRINTF.finditer(path.name), *HASHES.finditer(path.name)]
    if not found:
        return None
    if len(found) > 1:
        raise InputError(f"{path} has {len(found)} places for a number; it needs one")
    place = found[0]
    digits = len(place[0]) if place[0].startswith("#") else int(place[1] or 1)
    if digits > MOST_DIGITS:
        raise InputError(f"{path} asks for numbers of {digits} digits; give {MOST_DIGITS} or fewer")
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
        raise FileFormatError(f"{path}: no picture has such a name; check the pattern")
    _refuse_gaps(names, numbers)
    return PictureSequence(names, tuple(numbers))


def _files(folder: Path) -> list[Path]:
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: no such folder; numbered pictures are needed in it")
    return [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]


def _names_in(folder: Path) -> Numbered:
    """The naming scheme of the numbered pictures in a folder."""
    found: dict[tuple[str, str], list[str]] = {}
    for file in _files(folder):
        match = LAST_NUMBER.fullmatch(file.stem)
        if match and file.suffix in SUFFIXES:
            found.setdefault((match[1], match[3] + file.suffix), []).append(match[2])
    if len(found) != 1:
        named = ", ".join(sorted(f"{before}#{after}" for before, after in found)) or "none"
        raise FileFormatError(
            f"{folder} holds these sequences of pictures: {named}. Name one by a pattern such as "
            "sky.%04d.exr"
        )
    ((before, after), numbers) = found.popitem()
    names = Numbered(folder, before, min(len(number) for number in numbers), after)
    padded = [
        name for n in sorted(numbers) if names.number_of(name := f"{before}{n}{after}") is None
    ]
    if padded:
        shortest = f"{before}{min(numbers, key=len)}{after}"
        raise FileFormatError(
            f"{folder}: the numbers of {shortest} and {padded[0]} are padded differently; rename some, "
            "or choose some by a pattern such as sky.%04d.exr"
        )
    return names


def _refuse_gaps(names: Numbered, numbers: list[int]) -> None:
    step = math.gcd(*(b - a for a, b in pairwise(numbers))) or 1
    missing = (numbers[-1] - numbers[0]) // step + 1 - len(numbers)
    if not missing:
        return
    each = (n for a, b in pairwise(numbers) for n in range(a + step, b, step))
    listed = ", ".join(names.path(n).name for n in islice(each, MAX_LISTED))
    more = f" and {missing - MAX_LISTED} more" if missing > MAX_LISTED else ""
    raise FileFormatError(
        f"{names}: {listed}{more} missing between {names.path(numbers[0]).name} and "
        f"{names.path(numbers[-1]).name}; render them again"
    )
