"""Commands that run out of disk, by a limit on the size of files or on a small file system.

`run_short` makes one run and checks it. As a program, started by studies/full_disk.py, it makes 300 in a
given folder and prints a line of JSON for each; by root, who may mount file systems.
"""

import json
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from bundles import write_bundle
from hand_meter import Meter, as_csv
from lossless_movies import write_lossless
from small_files import files_up_to
from tiny_venue import (
    Ran,
    contents,
    make_venue,
    one_thread,
    procam,
    quick_simulator,
    solved,
    take_session,
)

from procam.files.calibration import load_calibration
from procam.files.images.pixels import write_image

Command = Callable[[Path], tuple[object, ...]]
COMMANDS: dict[str, Command] = {
    "init": lambda d: ("init", d / "new", "--template", "by-hand"),
    "capture": lambda d: ("session", "capture", d / "fresh"),
    "solve": lambda d: ("session", "solve", d / "venue" / "sessions" / "0001"),
    "calibrate": lambda d: ("calibrate", d / "fresh"),
    "recalibrate": lambda d: ("recalibrate", d / "venue", "--projector", "south"),
    "refine": lambda d: ("refine", d / "venue"),
    "state": lambda d: ("state", d / "venue", "full"),
    "meter": lambda d: ("meter", d / "venue", d / "readings.csv"),
    "report": lambda d: ("report", d / "venue"),
    "bundle": lambda d: ("venue", "pack", d / "venue", d / "out.zip"),
    "opened bundle": lambda d: ("venue", "unpack", d / "venue.zip", d / "new"),
    "patterns": lambda d: ("session", "plan", d / "venue", d / "out"),
    "movie": lambda d: ("session", "plan", d / "venue", d / "out", "--movie"),
    "code": lambda d: ("lens", "patterns", d / "out", "--size", "64x48"),
    "picture": lambda d: ("compensate", _calibration(d), d / "sky" / "0001.png", d / "out.exr"),
    "stills": lambda d: ("compensate", _calibration(d), d / "sky", d / "out.%04d.png"),
    "part of stills": lambda d: (
        *("compensate", _calibration(d), d / "sky", d / "out.%04d.png"),
        *("--frames", "1-2"),
    ),
    "frames of projectors": lambda d: (
        *("compensate", _calibration(d), d / "sky", d / "out"),
        *("--to", "projectors"),
    ),
    "compensated movie": lambda d: (
        *("compensate", _calibration(d), d / "sky.mkv", d / "out.mov"),
        *("--transfer", "srgb"),
    ),
    "track": lambda d: ("export", _calibration(d), "shader", d / "sky", d / "out"),
}
OUTCOMES = 0, 1  # 1: a loop that found nothing better
RUNS = 20  # of each command, half of them with each kind of limit
CHANGING = ("index.jsonl", "log.json", "in-use")  # hold times of their own
MOMENT = re.compile(rb"\d+ [A-Z][a-z]+ 20\d\d, \d\d:\d\d")  # in a report
BLOCK = 4096  # of a file system


def _calibration(folder: Path) -> Path:
    return folder / "venue" / "calibrations" / "0001"


def make_work(folder: Path) -> None:
    """A venue with a calibration, one without a session, and pictures to compensate."""
    noise = np.random.default_rng(0).random((3, 64, 64, 3))
    for number, picture in enumerate(noise):
        write_image(folder / "sky" / f"{number:04d}.png", (picture * 65535).astype(np.uint16))
    write_lossless(folder / "sky.mkv", (noise * 255).astype(np.uint8))
    venue = make_venue(folder / "venue")
    session = take_session(venue)
    solved(venue, session)
    write_bundle(venue, session, folder / "venue.zip")
    meter = Meter(load_calibration(venue.directory / "calibrations" / "0001"))
    (folder / "readings.csv").write_text(as_csv(meter.read_all(("south", (40, 64)))), "utf-8")
    make_venue(folder / "fresh")


def run_short(
    command: Command, folder: Path, whole: dict[str, bytes], limit: Callable[..., object]
) -> Ran:
    """Run a command in `folder` within a limit, then without; check that nothing good is lost or damaged.

    `whole` are the files after a run that had room; `limit()` is a context in which there is little.
    """
    before = _files(folder)
    with limit():
        stopped = procam(*command(folder))
    assert stopped.code in {*OUTCOMES, 2}, stopped
    if stopped.code == 2:
        assert stopped.err.splitlines()[-1].startswith("procam: "), stopped
        assert "Traceback" not in stopped.err, stopped
    left = _files(folder)
    lost = [name for name in before if left.get(name) not in (before[name], whole.get(name))]
    assert not lost, f"changed or lost: {lost}"
    damaged = [name for name in left if name not in before and left[name] != whole.get(name)]
    assert not damaged, f"not as they should be: {damaged}"
    assert not [name for name in left if ".tmp" in name], list(left)
    return stopped


def run_again(command: Command, folder: Path, whole: dict[str, bytes]) -> None:
    """Run a command that was stopped once more, with room: all must be there."""
    done = procam(*command(folder))
    assert done.code in OUTCOMES, done
    left = _as_if_not_stopped(_files(folder), whole)
    # a session or a calibration that was whole when the disk got full stays beside the next one
    extra = [name for name in left if name not in whole]
    odd = [n for n in extra if "/calibrations/" not in n and "/sessions/" not in n]
    # whose report is of other photographs
    odd += [n for n in whole if left.get(n) != whole[n] and not (extra and n.endswith(".html"))]
    assert not odd, f"not as in a run with room: {sorted(odd)}"


def _as_if_not_stopped(left: dict[str, bytes], whole: dict[str, bytes]) -> dict[str, bytes]:
    """The files as if a stopped recalibration had left no session, which the next one does not resume."""
    stopped, second = "sessions/0002", "sessions/0003"
    if not any(second in name for name in left):
        return left
    found = {n: c.replace(b'"session": "0003"', b'"session": "0002"') for n, c in left.items()}
    if all(name in left for name in whole if stopped in name):
        return found
    return {n.replace(second, stopped): c for n, c in found.items() if stopped not in n}


def _files(folder: Path) -> dict[str, bytes]:
    """Files by name that are the same in every run."""
    changing = (*CHANGING, ".lock", ".log", "procam.jsonl")  # logs say when
    found = {n: c for n, c in contents(folder).items() if not n.endswith(changing)}
    return {n: MOMENT.sub(b"", c) if n.endswith(".html") else c for n, c in found.items()}


@contextmanager
def room_for(folder: Path, size: int) -> Iterator[None]:
    """Fill the small file system of `folder` up, but for `size` bytes."""
    assert folder.parent.is_mount(), "this would fill a real disk"
    ballast = folder.parent / "ballast"
    free = shutil.disk_usage(folder).free
    ballast.write_bytes(bytes(max(0, free - size)))
    try:
        yield
    finally:
        ballast.unlink()


@contextmanager
def small_disk(place: Path, size: int) -> Iterator[Path]:
    """A file system of its own in memory."""
    place.mkdir()
    subprocess.run(("mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)), check=True)
    try:
        yield place
    finally:
        subprocess.run(("umount", str(place)), check=True)


def in_full(command: Command, work: Path, folder: Path) -> dict[str, bytes]:
    """The files after a run with room."""
    shutil.copytree(work, folder)
    done = procam(*command(folder))
    assert done.code in OUTCOMES, done
    whole = _files(folder)
    shutil.rmtree(folder)
    return whole


def _runs(folder: Path) -> Iterator[dict[str, object]]:
    rng, work, here = random.Random(0), folder / "work", folder / "disk" / "here"
    make_work(work)
    with small_disk(folder / "disk", 2**28):
        for name, command in COMMANDS.items():
            whole = in_full(command, work, here)
            new = {n: len(c) for n, c in whole.items() if not (work / n).is_file()}
            for number in range(RUNS):
                shutil.copytree(work, here)
                share = rng.choice((0, rng.random(), 1))
                if number % 2:
                    largest = max(new.values())
                    limit, kind = (lambda size=int(share * largest): files_up_to(size)), "size"
                else:
                    total = sum(-(-size // BLOCK) * BLOCK for size in new.values())
                    limit, kind = (lambda size=int(share * total): room_for(here, size)), "disk"
                stopped = run_short(command, here, whole, limit)
                if stopped.code == 2:
                    run_again(command, here, whole)
                shutil.rmtree(here)
                yield {
                    "command": name,
                    "limit": kind,
                    "share": share,
                    "stopped": stopped.code == 2,
                }


def main() -> None:
    one_thread()
    with quick_simulator():
        for row in _runs(Path(sys.argv[1])):
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
