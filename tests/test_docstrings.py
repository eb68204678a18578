"""Attributes and parameters that docstrings describe exist."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "procam"
SECTION = re.compile(r"\n\s*(?:Attributes|Parameters)\n\s*-+\n(.*?)(?=\n\s*\n|\Z)", re.DOTALL)
ENTRY = re.compile(r"(?:^[ ]{0,8}|(?<=[.;?)] ))(\w+(?:, \w+)*) : ", re.MULTILINE)
Node = ast.ClassDef | ast.FunctionDef


def described(docstring: str) -> set[str]:
    """Names that a docstring's sections of attributes and parameters describe."""
    entries = [ENTRY.findall(section) for section in SECTION.findall(docstring)]
    return {name for found in entries for group in found for name in group.split(", ")}


def defined(node: Node) -> set[str]:
    """Names of a class's fields, properties and parameters, or of a function's parameters."""
    functions = [n for n in ast.walk(node) if isinstance(n, ast.FunctionDef)]
    names = {n.name for n in functions}
    for one in functions:
        arguments = one.args
        every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
        names |= {a.arg for a in (*every, arguments.vararg, arguments.kwarg) if a}
    targets = [n.target for n in ast.walk(node) if isinstance(n, ast.AnnAssign)]
    attributes = [n for n in ast.walk(node) if isinstance(n, ast.Attribute)]
    assigned = {a.attr for a in attributes if ast.unparse(a.value) == "self"}
    return names | assigned | {ast.unparse(t) for t in targets}


def documented() -> Iterator[tuple[str, str, Node]]:
    """File, docstring and node of every class and function."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, Node) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(PACKAGE)}:{node.lineno}", text, node


def test_what_docstrings_describe_exists() -> None:
    stale = {
        f"{place} {node.name}: {', '.join(sorted(missing))}"
        for place, text, node in documented()
        if (missing := described("\n" + text) - defined(node))
    }
    assert not stale


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("One.\n\nAttributes\n----------\nlit : seen. hidden, base : dark (H, W).", 3),
        ("One.\n\nParameters\n----------\nlit : a ratio 1 : 2 of light.\n", 1),
        ("One. name : of nothing.", 0),
    ],
)
def test_entries_are_found(text: str, names: int) -> None:
    assert len(described("\n" + text)) == names
