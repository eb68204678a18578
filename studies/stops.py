"""Signals at random moments of all commands that light projectors: what is lit at the end, what is said.

Each command runs in a process of its own with emulated projectors behind serial lines, and gets one, two or
five INT, TERM or HUP. tests/workflow/crash_driver.py checks each run; tests/workflow/test_crash.py has nine.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections import Counter

from studies.measure import HERE, write

DRIVER = HERE.parent / "tests" / "workflow" / "crash_driver.py"
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
STOPPED = 128  # exit codes from here on are of a signal


def main() -> None:
    """Stop the commands at 200 moments and write studies/stops.json and .md."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            (sys.executable, str(DRIVER), "stops", folder),
            env=os.environ | ONE_THREAD,
            stdout=subprocess.PIPE,
            text=True,
            check=True,  # the driver ends with an error if a projector is lit or a sentence is false
        )
    (ends,) = json.loads(done.stdout.splitlines()[-1])
    runs = Counter(end.split()[0] for end in ends)
    stopped = Counter(end.split()[0] for end in ends if int(end.split()[1]) > STOPPED)
    rows = [{"command": name, "runs": runs[name], "stopped": stopped[name]} for name in runs]
    write("stops", {"rows": rows}, _table(rows))


def _table(rows: list[dict[str, object]]) -> list[str]:
    return [
        "# Runs that were stopped",
        "",
        "INT, TERM or HUP, one, two or five of it within 0.1 s, at a random moment; the other runs had ended "
        "before. In all of them the lamps of the emulated projectors were dark at the end, what was printed "
        "and the exit code were true, and all calibrations could be read.",
        "",
        "| command | runs | stopped |",
        "|---|---|---|",
        *(f"| {' | '.join(str(value) for value in row.values())} |" for row in rows),
    ]
