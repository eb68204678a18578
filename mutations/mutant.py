"""One mutation: a copy of the tree, its change, and the tests on it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mutations.definitions import Definition, read_definitions

LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv*", ".*_cache", ".hypothesis", "__pycache__", "build", "demo-run", "_build"
)
KERNELS = "procam/kernels/"
BUILD = "from setuptools import setup; setup()"
MOST_S = 300  # of one run of tests; a mutation that hangs is noticed too
PASSED, FAILED = 0, 1  # exit codes of pytest
ALONE = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PYTHONDONTWRITEBYTECODE"), "1")


class Broken(Exception):
    """A run that says nothing about the tests."""


@dataclass(frozen=True, slots=True)
class Mutation:
    """A mistake: `old` becomes `new` in the source of `definition`, and `tests` must notice.

    `name` says it in words; `lives` is the argument why a survivor may live, "" where none may.
    """

    name: str
    definition: str
    old: str
    new: str
    tests: tuple[str, ...]
    lives: str = ""

    def find(self, definitions: Mapping[str, Sequence[Definition]]) -> Definition:
        """The one of that name that holds the old text, once."""
        named = definitions.get(self.definition, ())
        counts = [each.source.count(self.old) for each in named]
        if sum(counts) != 1:
            held = f"{self.definition} holds {self.old!r} {sum(counts)} times, not once"
            wrong = held if named else f"nothing is named {self.definition}"
            raise Broken(f"{self.name}: {wrong}; correct mutations/list.toml")
        return named[counts.index(1)]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a mutation: `killer` is the test that failed, "" for a survivor."""

    mutation: Mutation
    killer: str
    seconds: float

    @property
    def killed(self) -> bool:
        """Whether a test failed."""
        return bool(self.killer)


def read_mutations(path: Path) -> list[Mutation]:
    """The mutations of a list."""
    entries = tomllib.loads(path.read_text("utf-8"))["mutation"]
    return [Mutation(**entry | {"tests": tuple(entry["tests"])}) for entry in entries]


def tried(mutation: Mutation, root: Path) -> Outcome:
    """Mutate a copy of the tree at `root` and run its tests.

    Raises
    ------
    Broken
        The old text is not there once, the kernels do not build, or the tests do not run.
    """
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        copy = copied(root, Path(folder) / "tree")
        changed = mutation.find(read_definitions(copy))
        changed.replace(mutation.old, mutation.new)
        if changed.is_c:
            build_kernels(copy)
        try:
            killer = failure(copy, mutation.tests)
        except Broken as error:
            raise Broken(f"{mutation.name}: {error}") from error
    return Outcome(mutation, killer, time.monotonic() - start)


def copied(root: Path, to: Path, kernels: bool = False) -> Path:
    """A copy of the tree without what is made from it; with `kernels` built as for mutations of them."""
    shutil.copytree(root, to, ignore=LEFT_OUT)
    if kernels:
        build_kernels(to)
    return to


def build_kernels(root: Path) -> None:
    """Build the kernels in place, unoptimised, which takes seconds instead of a minute."""
    for built in (root / KERNELS).glob("_native*"):
        built.unlink()
    settings = root / "pyproject.toml"
    settings.write_text(settings.read_text("utf-8").replace('"-O3"', '"-O0"'), encoding="utf-8")
    _run([sys.executable, "-c", BUILD, "-q", "build_ext", "--inplace"], root)
    if not list((root / KERNELS).glob("_native*")):
        raise Broken("the kernels do not build; a C compiler is needed (Debian: gcc libc6-dev)")


def failure(root: Path, tests: Sequence[str]) -> str:
    """The first of some tests that fails in a tree; "" if all pass."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-rfE", "--tb=line", *tests]
    try:
        ran = _run(command, root)
    except subprocess.TimeoutExpired:
        return f"no end within {MOST_S} s"
    if ran.returncode == PASSED:
        return ""
    found = re.search(r"^FAILED \S*?([^/\s]+\.py::\S+)", ran.stdout, re.MULTILINE)
    if ran.returncode != FAILED or not found:
        raise Broken(f"the tests do not run: {ran.stdout[-500:]}{ran.stderr[-500:]}")
    return found[1]


def _run(command: Sequence[str], root: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, **ALONE, "PYTHONPATH": str(root)}
    return subprocess.run(
        command,
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        timeout=MOST_S,
        check=False,
    )
