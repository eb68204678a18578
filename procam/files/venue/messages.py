"""pydantic's findings about a venue.toml as plain sentences: where, what is wrong, what is needed."""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from procam.files.names import NAME_PATTERN
from procam.files.venue.tables import (
    BY_HAND,
    CLOCK_PATTERN,
    RESPONSE_PATTERN,
    BoxTable,
    CylinderTable,
    DomeTable,
    MeshTable,
    VenueTable,
)

OUTLINES = ("masks", "protected")  # lists whose entries are polygons or files
SCREENS: dict[str | int, type[BaseModel]] = {
    "dome": DomeTable,
    "box": BoxTable,
    "cylinder": CylinderTable,
    "mesh": MeshTable,
}
NUMBER, WHOLE = "a number", "a whole number"
LIST, TABLE = "a list in brackets", "a table of name = value"
# what an entry must be, by pydantic's name of the mistake; filled from its context
NEEDED = {
    "literal_error": "{expected}",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "finite_number": "a finite number",
    "float_type": NUMBER,
    "float_parsing": NUMBER,
    "int_type": WHOLE,
    "int_parsing": WHOLE,
    "int_from_float": WHOLE,
    "string_type": "text in quotes",
    "list_type": LIST,
    "tuple_type": LIST,
    "dict_type": TABLE,
    "model_type": TABLE,
    "too_short": "at least {min_length} of them",
    "too_long": "at most {max_length} of them",
    "union_tag_invalid": "one of {expected_tags}",
}
PATTERNS = {
    CLOCK_PATTERN: "a local time such as 03:00, in quotes",
    NAME_PATTERN: "a name of letters, digits, - and _ that begins with a letter or digit",
    RESPONSE_PATTERN: '"linear", "srgb", "solve" or a table\'s name that ends in .csv',
}


def explain(error: Mapping[str, Any], backends: Sequence[str]) -> str:
    """One line on an entry of `ValidationError.errors()`; `backends` may have tables of their own."""
    kind, loc = _kind_of_screen(error["loc"])
    error = {**error, "loc": loc}
    where, value = _place(loc), error["input"]
    if error["type"] == "union_tag_not_found":
        where, error = f"{where}.kind", {**error, "type": "missing"}
    if error["type"] == "union_tag_invalid":
        where, value = f"{where}.kind", error["ctx"]["tag"]
    if error["type"] == "missing":
        return f"{where} is missing; add it (`procam init` writes a complete example)"
    if error["type"] == "extra_forbidden":
        return f"{where} is not a known key; {_known_keys(loc, backends, kind)}"
    shown = "a table" if isinstance(value, dict) else repr(value)
    return f"{where} is {shown}; it must be {_needed(error)}"


def _kind_of_screen(where: Sequence[str | int]) -> tuple[str, Sequence[str | int]]:
    """The kind of screen that pydantic puts into paths, and the path without it."""
    if where[0] == "screen" and len(where) > 1 and where[1] in SCREENS:
        return str(where[1]), (where[0], *where[2:])
    return "", where


def _needed(error: Mapping[str, Any]) -> str:
    kind, where, context = error["type"], error["loc"], error.get("ctx", {})
    if kind == "string_pattern_mismatch":
        return PATTERNS[context["pattern"]]
    if kind == "list_type" and _is_outline(where, len(where) - 1):
        return "a polygon [[x, y], ...] or the name of a PNG"
    if kind == "list_type" and isinstance(error["input"], dict):
        return f"a list of tables, each under [[{'.'.join(map(str, where))}]]"
    if kind == "value_error":
        return str(context["error"])
    if kind not in NEEDED:
        return str(error["msg"]).removeprefix("Input should be ")
    needed = NEEDED[kind].format(**context)
    return f"one of {needed}" if " or '" in needed else needed


def _place(where: Sequence[str | int]) -> str:
    """The dotted path, without the parts that pydantic adds."""
    kept = (
        str(part) for i, part in enumerate(where) if part != "[key]" and not _is_outline(where, i)
    )
    return ".".join(kept)


def _is_outline(where: Sequence[str | int], i: int) -> bool:
    """Whether part `i` is only the kind of outline, polygon or file, that pydantic chose."""
    return i > 1 and isinstance(where[i - 1], int) and where[i - 2] in OUTLINES


def _known_keys(where: Sequence[str | int], backends: Sequence[str], kind: str) -> str:
    """The keys of the table with an unknown one, and the nearest; `kind` is that of the screen."""
    table = SCREENS[kind] if kind and len(where) == 2 else _table_at(where[:-1])
    first = [key for key in table.__annotations__ if key in table.model_fields]
    known = list(dict.fromkeys([*first, *table.model_fields]))
    at_top = len(where) == 1
    own = f", and the table of a backend that a device names ({', '.join(backends) or BY_HAND} now)"
    near = get_close_matches(str(where[-1]), [*known, *backends] if at_top else known, 1)
    advice = f"did you mean {near[0]}?" if near else "remove it or check its spelling."
    return f"{advice} The keys are {', '.join(known)}{own if at_top else ''}"


def _table_at(where: Sequence[str | int]) -> type[BaseModel]:
    """The table at a path of the file."""
    table: type[BaseModel] = VenueTable
    parts = iter(where)
    for part in parts:
        annotation = table.model_fields[str(part)].annotation
        table = next(_tables_in(annotation))
        if get_origin(annotation) in (dict, list):
            next(parts)  # the name or number of one of them
    return table


def _tables_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _tables_in(inner)
