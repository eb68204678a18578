"""The words that docs/nomenclature.md rules out appear neither in names nor in prose."""

import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
HERE = Path(__file__)
NOT_PROSE = {HERE, ROOT / "docs" / "nomenclature.md"}  # these list the words
PYTHON = [
    path
    for folder in ("procam", "simulators", "tests", "studies", "benchmarks", "mutations")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
TEXTS = [
    path
    for folder in ("procam", "docs", "studies", "benchmarks", "mutations", "calib_data")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in (".md", ".h", ".c", ".frag", ".glsl", ".html", ".toml")
    and "_build" not in path.parts
] + sorted(ROOT.glob("*.md"))
NAME_PARTS = {
    "begun",
    "belief",
    "bumps",
    "crew",
    "doubt",
    "doubts",
    "house",
    "hung",
    "landing",
    "relief",
    "tells",
    "told",
    "twin",
    "untold",
    "visit",
}
WORDS = re.compile(
    r"\b(told|tells|brings|brought|house|begun|doubts?|twins?|hung|landings?|beliefs?|crew|visits?"
    r"|what is left|stands for|errs by|bounced)\b",
    re.IGNORECASE,
)
STORED = {"bumps", "flux_doubt"}  # keys of files that venues hold
FEWEST = 20  # hits of one word that plain English may still need
FOR_VISITORS = ("procam/interfaces", "docs")  # "bounced light" is for people who see a dome


def parts(name: str) -> set[str]:
    """The words of an identifier in snake or camel case."""
    return {part.lower() for part in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


def names(tree: ast.AST) -> Iterator[str]:
    """What a module defines: functions, classes, arguments, attributes, variables."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def prose(path: Path) -> str:
    """Comments and strings of a Python file; all of any other."""
    text = path.read_text("utf-8")
    if path.suffix != ".py":
        return text
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return "\n".join(t.string for t in tokens if t.type in (tokenize.STRING, tokenize.COMMENT))


def test_names_are_words_of_the_field() -> None:
    found = {
        (str(path.relative_to(ROOT)), name)
        for path in PYTHON
        if path != HERE
        for name in names(ast.parse(path.read_text("utf-8")))
        if parts(name) & NAME_PARTS and name not in STORED
    }
    assert found == set()


def test_prose_is_plain() -> None:
    hits: Counter[str] = Counter()
    places: dict[str, list[str]] = {}
    for path in [*PYTHON, *TEXTS]:
        if path in NOT_PROSE:
            continue
        for_visitors = str(path.relative_to(ROOT)).startswith(FOR_VISITORS)
        for word in WORDS.findall(prose(path)):
            if for_visitors and word.lower() == "bounced":
                continue
            hits[word.lower()] += 1
            places.setdefault(word.lower(), []).append(str(path.relative_to(ROOT)))
    often = {word: places[word] for word, count in hits.items() if count >= FEWEST}
    assert often == {}
