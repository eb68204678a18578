"""Largest memory and time of `procam session solve`, by the size of the camera and the number of projectors.

`python -m benchmarks.memory FOLDER` captures simulated sessions of all `SIZES` into FOLDER, which takes 30 GB
there, solves each in a process of its own and writes memory.md; an hour. Sessions that are there are
used again. `make bench` measures the first.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measure import Goal, Report, Times
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.workflows.capture.capture import capture, prepare_session
from procam.workflows.venue_rig import open_rig
from simulators.scene import SceneSize
from simulators.template import venue_text

# the kernel's own figure: the largest memory that `wait` gives for a process includes that of its parent
SOLVE = """import atexit, sys
from pathlib import Path
from procam.interfaces.cli.main import main
atexit.register(lambda: sys.stderr.write(Path("/proc/self/status").read_text()))
main()"""
PANEL = (1920, 1200)
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Size:
    """Pixels (width, height) of the camera, the number of projectors, and most memory of a solve [GB]."""

    camera: tuple[int, int]
    projectors: int
    most_gb: float

    @property
    def name(self) -> str:
        """Of its folder, and in the table."""
        return f"{self.camera[0]}x{self.camera[1]}-{self.projectors}"


SIZES = (
    Size((1600, 1600), 2, 2.2),
    Size((2000, 2000), 6, 2.0),
    Size((6000, 4000), 6, 3.0),
)


def bench() -> Report:
    """The first size, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        size = SIZES[0]
        used_gb, wall_s = measured(size, captured(size, Path(folder)))
    megapixels = size.camera[0] * size.camera[1] / 1e6
    goal = Goal("largest memory of a solve", used_gb, "<=", size.most_gb, "GB")
    return Report(
        f"Solve of {size.projectors} projectors of {PANEL[0]} x {PANEL[1]}, camera of {megapixels:.1f} Mpx",
        {"procam session solve": Times(0.0, wall_s, wall_s, 1)},
        (goal,),
    )


def captured(size: Size, folder: Path) -> Path:
    """A simulated venue with a session, captured as far as it is not there."""
    directory = folder / size.name
    directory.mkdir(parents=True, exist_ok=True)
    scene = SceneSize(size.projectors, PANEL, camera_size=size.camera)
    (directory / "venue.toml").write_text(venue_text("standard", scene), "utf-8")
    venue, session = load_venue(directory), Session(directory / "sessions" / "0001")
    if not (session.directory / "plan.json").is_file():
        session = prepare_session(venue, session.directory)
    with open_rig(venue) as rig:
        for _ in capture(rig, venue, session):
            pass
    return directory


def measured(size: Size, directory: Path) -> tuple[float, float]:
    """Largest resident memory [GB] and wall time [s] of a solve in a process of its own."""
    start, session = time.perf_counter(), str(directory / "sessions" / "0001")
    command = [sys.executable, "-c", SOLVE, "session", "solve", session, "--json"]
    done = subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    if done.returncode:
        raise RuntimeError(
            f"procam session solve of {size.name} failed; run it by hand on {directory}"
        )
    most_kib = int(re.findall(r"VmHWM:\s+(\d+) kB", done.stderr.decode())[-1])
    return most_kib * 1024 / 1e9, time.perf_counter() - start


def table(folder: Path) -> Iterator[str]:
    """Markdown lines, a row for each size."""
    yield from ("# Memory of a solve", "")
    yield (
        f"Projectors of {PANEL[0]} x {PANEL[1]} px, cameras of three colours, on {os.cpu_count()} cores; "
        "`python -m benchmarks.memory FOLDER`."
    )
    yield from ("", "| camera | projectors | memory | asked for | time |", "|---|---|---|---|---|")
    for size in SIZES:
        used_gb, wall_s = measured(size, captured(size, folder))
        cells = (
            f"{size.camera[0]} x {size.camera[1]}",
            size.projectors,
            f"{used_gb:.1f} GB",
            f"{size.most_gb:g} GB",
            f"{wall_s / 60:.1f} min",
        )
        yield f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    text = "\n".join(table(Path(sys.argv[1])))
    (HERE / "memory.md").write_text(text + "\n", "utf-8")
    print(text)
