"""TOML files that people write, within limits that only damaged or foreign files pass."""

import re
import tomllib
from pathlib import Path
from typing import Any

from procam.errors import InputError

MOST_BYTES = 2**17  # the parser needs a second for twice as many short tables
NAMES = 16  # of a key, with dots between; the parser takes the square of their number
DOTTED = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{NAMES}}}")


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
        if any(line.count(".") >= NAMES and DOTTED.search(line) for line in text.splitlines()):
            raise ValueError(f"a key has more than {NAMES} names")
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # also of encodings and huge integers
        raise InputError(f"{path} is not valid TOML: {error}") from error
