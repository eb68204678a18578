"""Commands that run out of disk after a part of what they need: what is lost, damaged, or not made up for.

Each command runs with room for 0 to 100 % of its files, by a limit on their size or on a small file system of
its own. tests/workflow/disk_driver.py checks each run; tests/workflow/test_full_disk_commands.py has one of
each command. Writes studies/full_disk.json and studies/full_disk.md; `python -m studies full-disk`
remakes them in ten minutes, as root, who may mount file systems.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

from studies.measure import HERE, write
from studies.stops import ONE_THREAD

TESTS = HERE.parent / "tests"
DRIVER = TESTS / "workflow" / "disk_driver.py"
PATHS = os.pathsep.join((str(HERE.parent), str(TESTS)))


def main() -> None:
    """Run all commands and write studies/full_disk.json and .md."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            (sys.executable, str(DRIVER), folder),
            env=os.environ | ONE_THREAD | {"PYTHONPATH": PATHS},
            stdout=subprocess.PIPE,
            text=True,
            check=True,  # the driver ends with an error if anything is lost, damaged or not made up for
        )
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    write("full_disk", {"rows": rows}, _table(rows))


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "# Full disks",
        "",
        f"{len(rows)} runs with room for a part of the files. All that stopped had exit code 2 and one line "
        "of error, no file was lost or damaged, and a second run made the same files as one with room.",
        "",
        "| command | limit on the size of files: runs, stopped | small file system: runs, stopped |",
        "|---|---|---|",
    )
    for name in dict.fromkeys(row["command"] for row in rows):
        cells = []
        for kind in ("size", "disk"):
            of = [row["stopped"] for row in rows if (row["command"], row["limit"]) == (name, kind)]
            cells.append(f"{len(of)}, {sum(of)}")
        yield f"| {name} | {' | '.join(cells)} |"
