"""`procam reproduce`: the figures and studies of the documentation, remade in a clone of the repository."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer

import procam
from procam.errors import InputError
from procam.interfaces.cli._options import Json
from procam.interfaces.cli._output import Output

EXAMPLE = "procam reproduce recalibration"
ALL = "all"
ROOT = Path(procam.__file__).parents[1]


def reproduce(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help=f"Of studies; {ALL} of them take days."),
    ] = None,
    *,
    json: Json = False,
) -> None:
    """Remake figures and studies of the documentation; without a NAME, list them.

    A study writes its JSON and its table to the folder studies of the clone that procam runs from, `readme`
    docs/before-after.png, `speed` benchmarks/results.md; `git diff` then shows what has changed.
    """
    if not (ROOT / "studies" / "__main__.py").is_file():
        raise InputError(
            f"{ROOT}: procam runs from an installation without its studies; clone the repository, run "
            "`make demo` there, and call .venv/bin/procam reproduce"
        )
    wanted = [] if ALL in (names or ()) else names or ["--list"]
    command, stderr = [sys.executable, "-m", "studies", *wanted], 2
    run = subprocess.run(command, check=False, cwd=ROOT, stdout=stderr if json else None)
    Output(json).finish({"names": names or [], "repository": str(ROOT)})
    raise typer.Exit(run.returncode)
