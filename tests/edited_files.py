"""Files changed as people and mistakes change them."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def rewrite(path: Path, old: str, new: str) -> Path:
    """Replace text that must be there."""
    text = path.read_text("utf-8")
    assert old in text, old
    path.write_text(text.replace(old, new), "utf-8")
    return path


@contextmanager
def rewritten(path: Path, pattern: str, new: str) -> Iterator[Path]:
    """The file with what a pattern matches replaced, line by line, for a while."""
    kept = path.read_text("utf-8")
    text, changes = re.subn(pattern, new, kept, flags=re.MULTILINE)
    assert changes, pattern
    path.write_text(text, "utf-8")
    try:
        yield path
    finally:
        path.write_text(kept, "utf-8")


@contextmanager
def edited_json(path: Path) -> Iterator[Any]:
    """The document of a file, to be changed."""
    document = json.loads(path.read_text("utf-8"))
    yield document
    path.write_text(json.dumps(document), "utf-8")
