"""Unattended runs in which something goes wrong: how long light stays on, and what is said.

Somebody comes in, the interlock hangs, is late, is killed or is gone, or a signal comes; and a camera, a
disk, the notification or a shutter fails. tests/workflow/unattended_driver.py runs and judges each run;
tests/workflow/test_unattended_runs.py has ten.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.measure import HERE, write

DRIVER = HERE.parent / "tests" / "workflow" / "unattended_driver.py"
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
SEEDS, BESIDE = 200, 8  # runs, most of which wait, and how many at a time
Row = dict[str, Any]


def main() -> int:
    """Run 200 seeds and write studies/unattended.json and .md; 1 if any run was wrong."""
    share = SEEDS // BESIDE
    with tempfile.TemporaryDirectory() as folder:
        running = [_start(Path(folder), n * share, (n + 1) * share - 1) for n in range(BESIDE)]
        rows = [json.loads(line) for each in running for line in each.communicate()[0].splitlines()]
    events = [_summary(event, rows) for event in dict.fromkeys(row["event"] for row in rows)]
    wrong = [row for row in rows if row["wrong"]]
    write("unattended", {"events": events, "wrong": wrong, "rows": rows}, _table(events, rows))
    return int(bool(wrong))


def _start(folder: Path, first: int, last: int) -> subprocess.Popen[str]:
    own = folder / str(first)
    own.mkdir()
    return subprocess.Popen(
        (sys.executable, str(DRIVER), str(first), str(last), str(own)),
        env=os.environ | ONE_THREAD,
        stdout=subprocess.PIPE,
        text=True,
    )


def _summary(event: str, rows: Sequence[Row]) -> Row:
    """Of all runs with an event."""
    own = [row for row in rows if row["event"] == event]
    lit = [row["light_s"] for row in own if row["light_s"] is not None]
    return {
        "event": event,
        "runs": len(own),
        "lit": len(lit),
        "longest_light_s": max(lit, default=None),
        "false_dark": sum("called dark, and is not" in row["wrong"] for row in own),
        "wrong": sum(bool(row["wrong"]) for row in own),
    }


def _table(events: Sequence[Row], rows: Sequence[Row]) -> list[str]:
    faults = sorted({row["fault"] for row in rows} - {""})
    return [
        "# Unattended runs in which something goes wrong",
        "",
        f"{len(rows)} runs of `procam verify --unattended` and `procam recalibrate --unattended` with "
        "emulated lamps, whose light is logged in real time. Each run has one of the events below at a "
        "random moment, and most have a fault of a device, a disk or a program beside it: "
        f"{', '.join(faults)}.",
        "",
        "Light is a picture that is not black from a lamp whose shutter is open. It is counted from the no "
        "of the interlock, from 2 s after an asking that was not answered, from the moment when the "
        "interlock was removed, or from the signal, in the runs in which a projector was lit then. Goal: "
        "1 s. A run is wrong if light was on for longer, if a projector was called dark and was not, if one "
        "was left lit or open without being named, or if the run ended without a message, without a "
        "notification or with an exit code that is none of its own.",
        "",
        "| event | runs | lit then | longest light after it, s | false dark | wrong |",
        "|---|---|---|---|---|---|",
        *(f"| {' | '.join(str(value) for value in row.values())} |" for row in events),
    ]
