"""Commands on a full disk: one line, exit 2, nothing lost, and the next run is whole."""

import resource
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tiny_venue import Ran, contents, make_venue, procam, quick_simulator, solved, take_session

from procam.files.images.pixels import write_image

Command = Callable[[Path], tuple[object, ...]]
COMMANDS: dict[str, tuple[int, Command]] = {
    "init": (2000, lambda d: ("init", d / "new", "--template", "by-hand")),
    "capture": (5000, lambda d: ("capture", d / "venue")),
    "solve": (50000, lambda d: ("solve", d / "venue" / "sessions" / "0001")),
    "state": (50000, lambda d: ("state", d / "venue", "full")),
    "report": (50000, lambda d: ("report", d / "venue")),
    "patterns": (2000, lambda d: ("patterns", d / "venue", "--out", d / "out")),
    "movie": (200000, lambda d: ("patterns", d / "venue", "--out", d / "out", "--movie")),
    "code": (300, lambda d: ("patterns", "--size", "64x48", "--out", d / "out")),
    "stills": (20000, lambda d: ("compensate", _calibration(d), d / "sky", d / "out.%04d.png")),
    "warp": (5000, lambda d: ("warp", _calibration(d), d / "sky" / "0001.png", d / "out")),
    "track": (20000, lambda d: ("track", _calibration(d), d / "sky", d / "out")),
}


def _calibration(folder: Path) -> Path:
    return folder / "venue" / "calibrations" / "0001"


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("disk")
    noise = np.random.default_rng(0).random((2, 64, 64, 3))
    for number, picture in enumerate(noise):
        write_image(folder / "sky" / f"{number:04d}.png", (picture * 65535).astype(np.uint16))
    with quick_simulator():
        venue = make_venue(folder / "venue")
        solved(venue, take_session(venue))
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk(name: str, work: Path, tmp_path: Path) -> None:
    room, command = COMMANDS[name]
    folder = tmp_path / "here"
    shutil.copytree(work, folder)
    if name == "capture":
        shutil.rmtree(folder / "venue" / "sessions")
    before = contents(folder)
    with quick_simulator():
        stopped = _with_room_for(room, command(folder))
        assert stopped.code == 2
        assert stopped.err.count("\n") == 1 and "may not grow that large" in stopped.err
        assert str(folder) in stopped.err and ".tmp" not in stopped.err
        left, before = (
            {n: c for n, c in files.items() if not n.endswith(".lock")}
            for files in (contents(folder), before)
        )
        assert {path: left[path] for path in before} == before
        assert not [path for path in left if ".tmp" in path]
        assert procam(*command(folder)).code == 0


def _with_room_for(size: int, command: tuple[object, ...]) -> Ran:
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limit[1]))
    try:
        return procam(*command)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
