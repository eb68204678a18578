"""Runs of a venue that are killed, or that meet a full disk: what its history then holds.

A child process records runs that each write a calibration. It is killed at a random moment, or its disk, a
file system in memory, gets full, or it may write so many bytes to a file and no more. `trial` checks one
child; tests/unit/files/test_history.py has a few. Writes studies/history.json and studies/history.md;
`python -m studies history` remakes them in a minute, as root, who may mount file systems.
"""

import json
import os
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from procam.errors import ProcamError
from procam.files.atomic import replacing_directory
from procam.files.history.read import list_figures, list_runs
from procam.files.history.record import recorded
from procam.files.history.store import NAME
from procam.files.versions import list_calibrations, next_directory
from procam.model.quality import Figure
from studies.measure import HERE, write

TRIALS = 50
KILL_WITHIN_S = 0.25
FIGURES = 40
LARGEST = {"file limit": 400_000, "full disk": 2_000_000}  # bytes
PAGE = 4096  # of memory, by which a file system in it grows
DOCUMENT = {
    "feedback": {"value": [0.3, 0.3, 0.3], "sigma": [0.01, 0.01, 0.01]},
    "albedo": {"value": [0.5, 0.5, 0.5], "sigma": [0.01, 0.01, 0.01]},
    "content_from_camera": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "quality": {},
    "provenance": {"session": "0001"},
}
Kind = Literal["killed", "file limit", "full disk"]
KINDS: tuple[Kind, ...] = ("killed", "file limit", "full disk")


@dataclass(frozen=True)
class Outcome:
    """A child: how many runs it said had ended, and how many more are in the history."""

    ended: int
    recorded: int
    cut_off: bool


def main() -> None:
    """Cut off 50 children in each way, and write studies/history.json and .md."""
    rng, rows = random.Random(0), list[dict[str, Any]]()
    for kind in KINDS:
        for _ in range(TRIALS):
            with tempfile.TemporaryDirectory() as folder:
                outcome = trial(Path(folder), kind, rng.random())
            rows.append({"kind": kind, **vars(outcome)})
    write("history", {"rows": rows}, _table(rows))


def trial(venue: Path, kind: Kind, share: float) -> Outcome:
    """Run a child in an empty folder and cut it off; raises AssertionError if anything is lost or damaged."""
    if kind == "full disk":
        with _small_disk(venue, PAGE + int(share * LARGEST[kind])) as enlarge:
            said = _said(venue, kind, share)
            enlarge()
            return _checked(venue, said)
    return _checked(venue, _said(venue, kind, share))


@contextmanager
def _small_disk(place: Path, size: int) -> Iterator[Callable[[], object]]:
    """A file system in memory; yields what makes it larger."""
    subprocess.run(("mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", place), check=True)
    larger = ("mount", "-o", "remount,size=100m", place)
    try:
        yield lambda: subprocess.run(larger, check=True)
    finally:
        subprocess.run(("umount", place), check=True)


def _said(venue: Path, kind: Kind, share: float) -> list[int]:
    """Numbers of the runs that a child has ended before it was cut off."""
    limit = int(share * LARGEST[kind]) if kind == "file limit" else resource.RLIM_INFINITY
    arguments = (sys.executable, "-m", "studies.history", str(venue), str(limit))
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, text=True, cwd=HERE.parent, env=os.environ
    ) as child:
        assert child.stdout
        assert child.stdout.readline() == "ready\n"
        if kind == "killed":
            time.sleep(share * KILL_WITHIN_S)
            child.send_signal(signal.SIGKILL)
        return [int(line) for line in child.stdout if line.endswith("\n")]


def _checked(venue: Path, said: list[int]) -> Outcome:
    """What the history holds, by SQLite's own check and by what the child has printed."""
    before = list_runs(venue)
    done = {run.id for run in before if run.outcome == "done"}
    assert set(said) <= done, "a run that had ended is lost"
    assert [run.id for run in before] == list(range(1, len(before) + 1))
    figures = list_figures(venue)
    for run in before:
        count = sum(f.run == run.id and f.calibration is None for f in figures)
        assert count == (FIGURES if run.outcome == "done" else 0), "figures half-written"
    with recorded(venue, "check"):
        pass
    *_, last = runs = list_runs(venue)
    assert last.outcome == "done" and not any(run.outcome == "running" for run in runs)
    known = {f.calibration for f in list_figures(venue)} - {None}
    assert known == {path.name for path in list_calibrations(venue)}, (
        "a calibration is not recorded"
    )
    with sqlite3.connect(venue / NAME) as db:
        assert db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert db.execute("PRAGMA foreign_key_check").fetchall() == []
    db.close()
    return Outcome(len(said), len(before), any(run.outcome != "done" for run in before))


def _child(venue: Path, limit: int) -> None:
    """Record runs until killed, or until no more can be written."""
    venue.mkdir(exist_ok=True)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    print("ready", flush=True)
    while True:
        try:
            with recorded(venue, "capture") as run:
                with replacing_directory(next_directory(venue)) as folder:
                    (folder / "calibration.json").write_text(json.dumps(DOCUMENT), "utf-8")
                run.measured(
                    {f"figure-{i}": Figure(i / 7, "px", sigma=0.1) for i in range(FIGURES)}
                )
        except (OSError, ProcamError):
            return
        print(run.id, flush=True)


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield from (
        "# Histories of runs that were cut off",
        "",
        "Processes that record runs: killed (SIGKILL) at a random moment, with a random limit on the size of "
        "files, or on a small disk. In all of them every run that had ended is in the history with all its "
        "figures, no run has a part of them, the next run records the calibrations that were on disk, and "
        "`integrity_check` is clean.",
        "",
        "| | processes | cut off within a run | runs ended | runs recorded |",
        "|---|---|---|---|---|",
    )
    for kind in KINDS:
        of = [row for row in rows if row["kind"] == kind]
        totals = (sum(row[key] for row in of) for key in ("cut_off", "ended", "recorded"))
        yield f"| {kind} | {len(of)} | {' | '.join(map(str, totals))} |"


if __name__ == "__main__":
    _child(Path(sys.argv[1]), int(sys.argv[2]))
