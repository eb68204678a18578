"""Commands on a full disk: one line, exit 2, nothing lost, and the next run is whole."""

import errno
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from disk_driver import COMMANDS, in_full, make_work, run_again, run_short
from small_files import files_up_to

from procam.files.history import record

ROOM = {
    **{"init": 2000, "capture": 5000, "calibrate": 20000, "patterns": 2000, "movie": 200000},
    **{"code": 300, "stills": 20000, "track": 20000, "picture": 20000},
    "compensated movie": 5000,
    "part of stills": 20000,
    "frames of projectors": 20000,
    "bundle": 1000000,  # a picture by itself needs less
}


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("disk")
    make_work(folder)
    return folder


QUICK = [name for name in COMMANDS if name not in {"refine", "calibrate"}]


@pytest.mark.parametrize("name", QUICK)
def test_a_full_disk(name: str, work: Path, tmp_path: Path) -> None:
    command, folder = COMMANDS[name], tmp_path / "here"
    whole = in_full(command, work, folder)
    shutil.copytree(work, folder)
    room = ROOM.get(name, 50000)
    stopped = run_short(command, folder, whole, lambda: files_up_to(room))
    assert stopped.code == 2
    assert stopped.err.count("\n") == 1 and re.search(
        "may not grow that large|the disk is full", stopped.err
    )
    assert str(folder) in stopped.err and ".tmp" not in stopped.err
    run_again(command, folder, whole)


def test_a_history_that_cannot_end_leaves_no_pictures_behind(
    work: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They would keep the second run from their folder."""
    command, folder = COMMANDS["patterns"], tmp_path / "here"
    whole = in_full(command, work, folder)
    shutil.copytree(work, folder)

    @contextmanager
    def no_room() -> Iterator[None]:
        def full(*_: object) -> None:
            raise OSError(errno.ENOSPC, "No space left on device", str(folder / "history.sqlite"))

        with monkeypatch.context() as patched:
            patched.setattr(record, "_end", full)
            yield

    assert run_short(command, folder, whole, no_room).code == 2
    run_again(command, folder, whole)
