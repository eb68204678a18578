"""Where functions, classes and constants are defined, by their names."""

import ast
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("procam", "simulators")


@dataclass(frozen=True, slots=True)
class Definition:
    """The source of a definition, which begins at a character of its file."""

    path: Path
    begin: int
    source: str

    @property
    def is_c(self) -> bool:
        """Whether the kernels must be built anew if it changes."""
        return self.path.suffix == ".h"

    def replace(self, old: str, new: str) -> None:
        """Change a text that it holds, in its file."""
        text = self.path.read_text("utf-8")
        rest = text[self.begin :].replace(old, new, 1)
        self.path.write_text(text[: self.begin] + rest, encoding="utf-8")


def read_definitions(root: Path) -> Mapping[str, Sequence[Definition]]:
    """The definitions of the packages at `root`, by qualified name.

    Those of Python have a second key with the module's last name, as in `noise:ROUNDING`. A C header is
    one definition, with its file name as key.
    """
    found = defaultdict(list)
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_text("utf-8")
            lines = [f"{line}\n" for line in text.split("\n")]
            for name, first, last in _defined(ast.parse(text).body):
                begin = sum(map(len, lines[: first - 1]))
                definition = Definition(path, begin, "".join(lines[first - 1 : last]))
                found[name].append(definition)
                found[f"{path.stem}:{name}"].append(definition)
        for path in sorted((root / package).rglob("*.h")):
            found[path.name].append(Definition(path, 0, path.read_text("utf-8")))
    return found


def _defined(body: Sequence[ast.stmt], prefix: str = "") -> Iterator[tuple[str, int, int]]:
    """Names with their first and last lines, decorators included."""
    for node in body:
        for name in _names(node):
            decorators = getattr(node, "decorator_list", [])
            first = min([node.lineno, *(each.lineno for each in decorators)])
            yield f"{prefix}{name}", first, node.end_lineno or first
        if isinstance(node, ast.ClassDef):
            yield from _defined(node.body, f"{prefix}{node.name}.")


def _names(node: ast.stmt) -> Sequence[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        every = [part for target in targets for part in ast.walk(target)]
        return [part.id for part in every if isinstance(part, ast.Name)]
    return []
