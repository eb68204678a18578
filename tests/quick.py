"""`make quick`: what breaks first, in a minute and a half.

The rules that hold for all modules, the unit tests of packages that differ from the last commit (or that
it changed, if nothing does), test files that differ, and one coarse run from photographs to a verification.
"""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
RULES = ("architecture", "docstrings", "public_api", "words")
COARSE = "tests/workflow/test_cli_verify.py::test_all_is_well"


def changed() -> list[Path]:
    """Files that differ from the last commit, new ones too; those of the last commit if none does."""
    differ = _git("diff", "--name-only", "HEAD") + _git(
        "ls-files", "--others", "--exclude-standard"
    )
    return differ or _git("diff", "--name-only", "HEAD~1", "HEAD")


def _git(*command: str) -> list[Path]:
    ran = subprocess.run(["git", *command], cwd=ROOT, check=True, capture_output=True, text=True)
    return [Path(line) for line in ran.stdout.splitlines()]


def tests_of(path: Path) -> Iterator[str]:
    """Tests of a changed file: itself, or those beside which its package's are."""
    if path.parts[0] == "tests" and path.name.startswith("test_") and (ROOT / path).is_file():
        yield str(path)
    if path.parts[0] == "simulators":
        yield "tests/simulators"
    if path.parts[0] == "procam":
        folders = [Path("tests/unit", *path.parts[1:n]) for n in range(len(path.parts), 1, -1)]
        yield from (str(folder) for folder in folders[:-1] if (ROOT / folder).is_dir())


def main() -> int:
    """Run them."""
    found = {next(tests_of(path), "") for path in changed()} - {""}
    rules = [f"tests/test_{name}.py" for name in RULES]
    flags = ["-q", "-n", "2", "--dist", "worksteal", "-m", "not long"]
    command = [sys.executable, "-m", "pytest", *flags, *rules, *sorted(found), COARSE]
    return subprocess.run(command, cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
