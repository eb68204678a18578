"""TOML files that people write, within limits that only damaged or foreign files pass."""

import re
import tomllib
from pathlib import Path
from typing import Any

from procam.errors import InputError

MOST_BYTES = 2**17  # the parser needs a second for twice as many short tables
DOTTED = re.compile(r"(?:[\w\"'-]+[ \t]*\.[ \t]*){16}")  # their number of parts counts squared


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a file.

    Raises
    ------
    InputError
        It is no TOML, or far larger or deeper than such files are.
    """
    if path.stat().st_size > MOST_BYTES:
        raise InputError(
            f"{path} has more than {MOST_BYTES // 1024} KiB; write long masks as PNG files, and check "
            "that this is the right file"
        )
    try:
        text = path.read_text(encoding="utf-8-sig")  # some editors mark it
        if any(DOTTED.search(line.partition("#")[0]) for line in text.splitlines()):
            raise ValueError("a key has more than 16 names")
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of encodings and huge integers
        raise InputError(f"{path} is not valid TOML: {error}") from error
