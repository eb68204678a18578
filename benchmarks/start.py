"""From the start of a process to the first pixel on its stdout."""

import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import IO

import numpy as np

from benchmarks import frame
from benchmarks.measure import Goal, Report, Times
from procam.files.calibration import save_calibration
from procam.files.history.record import recorded
from procam.files.venue.load import create_venue
from procam.files.versions import next_directory
from procam.model.calibration import Calibration
from procam.model.quality import Figure
from procam.model.screen import Dome
from procam.model.transport import Measured, ScatterKernel, ScreenMaps
from studies.history import DOCUMENT

ROUNDS = 11
PROCAM = "from procam.interfaces.cli.main import main; main()"
PIPE = ("compensate", "0001", "-", "-", "--pixels", "rgb24", "--size")
LIBRARIES = """import sys, numpy, OpenImageIO, typer
from pathlib import Path
def command(calibration: Path, source: Path, out: Path, pixels: str, size: int, strength: float = 1):
    sys.stdout.write("done")
typer.run(command)
"""  # a command that does nothing, with parameters of the same types
RUNS: dict[
    str, tuple[tuple[str, ...], int]
] = {  # what Python is given; edge of the frame it is sent
    "libraries of --help": (("import typer, typer.rich_utils",), 0),
    "libraries of compensate": (
        (LIBRARIES, *("0001", "-", "-", "rgb24", "1024")),
        0,
    ),
    "--help": ((PROCAM, "--help"), 0),
    "compensate, 1024^2": ((PROCAM, *PIPE, "1024"), 1024),
    "compensate, 4096^2": ((PROCAM, *PIPE, "4096"), 4096),
    "history of 1000 runs": ((PROCAM, "venue", "status", "venue"), 0),
}


def bench() -> Report:
    """`procam compensate` of bare frames on a measured dome, beside what it imports and `--help`."""
    with tempfile.TemporaryDirectory() as folder:
        save_calibration(_calibration(), Path(folder) / "0001")
        _make_history(Path(folder) / "venue")
        times = _times(Path(folder))
    first = [n for n, (_, edge) in RUNS.items() if edge]
    beyond = (("--help", 100), ("compensate, 1024^2", 250), ("compensate, 4096^2", 250))
    goals = (
        *(_beyond_libraries(times, name, limit) for name, limit in beyond),
        *(Goal(f"{n}, best wall", 1e3 * times[n].best_wall_s, "<=", 500, "ms") for n in first),
        Goal(
            "history of 1000 runs, wall",
            1e3 * times["history of 1000 runs"].wall_s,
            "<=",
            600,
            "ms",
        ),
    )
    note = "CPU time of the whole process, wall time from its start to the first byte on its stdout"
    return Report("Start of a command, 1024^2 maps, to the first pixel", times, goals, (note,))


def _beyond_libraries(times: dict[str, Times], name: str, limit_ms: float) -> Goal:
    libraries = times[f"libraries of {name.split(',', maxsplit=1)[0]}"]
    spent = 1e3 * (times[name].best_wall_s - libraries.best_wall_s)
    return Goal(f"{name}, best wall beyond its libraries", spent, "<=", limit_ms, "ms")


def _times(folder: Path) -> dict[str, Times]:
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in RUNS}
    for _ in range(1 + ROUNDS):  # the first leaves bytecode and files in memory
        for name, (command, edge) in RUNS.items():
            sent = frame.content(edge).tobytes() if edge else b""
            spent[name].append(_until_first_byte(command, sent, folder))
    found = {}
    for name, pairs in spent.items():
        (cpu, wall), best = np.median(pairs[1:], axis=0), np.min(pairs[1:], axis=0)
        found[name] = Times(float(cpu), float(wall), float(best[1]), ROUNDS)
    return found


def _make_history(venue: Path) -> None:
    """A venue with 1000 runs, of which every 20th wrote a calibration, and 12 figures of each."""
    create_venue(venue, "simulated-small")
    for number in range(1000):
        with recorded(venue, "verify") as run:
            run.measured(
                {f"figure-{i}": Figure(number + i / 7, "px", sigma=0.1) for i in range(12)}
            )
            if number % 20 == 0:
                folder = next_directory(venue)
                folder.mkdir(parents=True)
                (folder / "calibration.json").write_text(json.dumps(DOCUMENT), "utf-8")


def _calibration() -> Calibration:
    model, some = frame.dome(frame.NODES, True).model, Measured(np.full(3, 0.3), np.full(3, 0.01))
    assert model.hi is not None
    bend = np.stack([np.diag([1.0, *[0.05] * 8])] * 3)
    kernel = ScatterKernel(2, bend, bend[:, 0])
    albedo = np.full_like(model.spread, 0.3)
    maps = ScreenMaps(model.spread, albedo, model.lo, model.hi, model.coverage, kernel=kernel)
    return Calibration(Dome(5.0, np.pi / 2), {}, {}, maps, some, some, np.eye(3))


def _until_first_byte(command: tuple[str, ...], sent: bytes, folder: Path) -> tuple[float, float]:
    """CPU time [s] of Python in a folder, sent a frame, and wall time until its first byte.

    Bytecode is kept, as that of an installed package is.
    """
    settings = os.environ | {"PYTHONPYCACHEPREFIX": str(folder)}
    settings.pop("PYTHONDONTWRITEBYTECODE", None)
    before, start = _children_s(), time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-c", *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # latencies
        env=settings,
        cwd=folder,
    ) as child:
        assert child.stdin is not None and child.stdout is not None
        sender = threading.Thread(target=_send, args=(child.stdin, sent))
        sender.start()
        child.stdout.read(1)
        wall = time.perf_counter() - start
        child.stdout.read()
        sender.join()
    if child.returncode:
        raise RuntimeError(f"{command[1:]}: ended with {child.returncode}")
    return _children_s() - before, wall


def _send(pipe: IO[bytes], sent: bytes) -> None:
    with pipe:
        pipe.write(sent)


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
