"""TOML: files that people write, within limits that only damaged or foreign files pass; tables as text."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
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


def toml_text(tables: Mapping[str, Any]) -> str:
    """Tables as a file that `read_toml` gives back: strings, numbers, lists and tables of these.

    Keys are letters, digits, "_" and "-".

    >>> print(toml_text({"a": {"size": [8, 0.5]}, "b": [{"name": "front"}]}), end="")
    [a]
    size = [8, 0.5]
    <BLANKLINE>
    [[b]]
    name = "front"
    """
    return "".join(_lines(tables, "")).lstrip("\n")


def _lines(table: Mapping[str, Any], path: str) -> Iterator[str]:
    """First the values of a table, then the tables in it."""
    inner = {key: value for key, value in table.items() if _is_tables(value)}
    yield from (f"{key} = {_value(v)}\n" for key, v in table.items() if key not in inner)
    for key, value in inner.items():
        name = f"{path}{key}"
        several = isinstance(value, list)
        for each in value if several else [value]:
            if several or not all(map(_is_tables, each.values())):
                yield f"\n[[{name}]]\n" if several else f"\n[{name}]\n"
            yield from _lines(each, f"{name}.")


def _is_tables(value: object) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and isinstance(value[0], dict)
    )


def _value(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return json.dumps(value)
