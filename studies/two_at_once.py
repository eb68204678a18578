"""Two commands at once on one venue, every pair: both work, or one is refused by name; all is whole.

Writes studies/two_at_once.json and studies/two_at_once.md; `python -m studies two-at-once` remakes them in
minutes. tests/workflow/test_venue_lock.py has a few pairs.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np

from procam.files.calibration import load_calibration
from procam.files.images.pixels import write_image
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.files.versions import list_calibrations
from simulators.scene import SceneSize
from simulators.template import venue_text
from studies.measure import write
from studies.photometry import calibrate_venue
from studies.stops import ONE_THREAD

SIZE = SceneSize(projectors=1, projector_size=(128, 80), camera_size=(200, 200), rays=64)
COMMANDS: Mapping[str, tuple[str, ...]] = {
    "session capture": ("VENUE",),
    "calibrate": ("VENUE",),
    "session solve": ("VENUE/sessions/0001",),
    "refine": ("VENUE",),
    "state": ("VENUE", "full"),
    "doctor": ("VENUE",),
    "projector": ("VENUE", "south", "state"),
    "session plan": ("VENUE", "OUT"),
    "venue use": ("VENUE@1",),
    "report": ("VENUE",),
    "compensate": ("VENUE", "VENUE/sky.png", "OUT.exr"),
}
WORKED = {0, 1}  # 1: doctor has findings, refine found nothing better


def make_busy_venue(folder: Path) -> None:
    """A calibrated venue, and a picture."""
    folder.mkdir(parents=True)
    (folder / "venue.toml").write_text(venue_text("standard", SIZE))
    write_image(folder / "sky.png", np.full((64, 64, 3), 99, np.uint8))
    calibrate_venue(load_venue(folder))


def run_both(venue: Path, names: tuple[str, str]) -> list[str]:
    """Run two commands at once; "worked" or "refused" of each. Raises AssertionError if anything is wrong."""
    running = [_start(venue, name, number) for number, name in enumerate(names)]
    ended = [(process.communicate()[1].decode(), process.returncode) for process in running]
    outcomes = []
    for said, code in ended:
        assert code in {*WORKED, 2} and "Traceback" not in said, (names, code, said)
        assert code in WORKED or "is at work there" in said, (names, said)
        outcomes.append("worked" if code in WORKED else "refused")
    assert "worked" in outcomes, (names, ended)
    _check_whole(venue)
    return outcomes


def _start(venue: Path, name: str, number: int) -> "subprocess.Popen[bytes]":
    out = str(venue.parent / f"out-{number}")
    given = (part.replace("VENUE", str(venue)).replace("OUT", out) for part in COMMANDS[name])
    return subprocess.Popen(
        (sys.executable, "-m", "procam", *name.split(), *given),
        env=os.environ | ONE_THREAD,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def _check_whole(venue: Path) -> None:
    """Every calibration and every photograph can be read, and no temporary file is left."""
    for calibration in list_calibrations(venue):
        load_calibration(calibration)
    loaded = load_venue(venue)
    for folder in (venue / "sessions").iterdir():
        session = Session(folder)
        shots = {shot.id: shot for shot in session.read_plan().shots}
        for name, camera in loaded.cameras.items():
            for shot, exposure_s in session.stored(name):
                session.load(name, shots[shot], exposure_s, camera.size)
    assert not list(venue.rglob("*.tmp*")), list(venue.rglob("*.tmp*"))


def main() -> None:
    """Run every pair and write studies/two_at_once.json and .md."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        ready = Path(folder) / "ready"
        make_busy_venue(ready)
        for names in combinations_with_replacement(COMMANDS, 2):
            place = Path(folder) / "here"
            shutil.copytree(ready, place / "venue")
            rows.append({"commands": names, "outcomes": run_both(place / "venue", names)})
            print(rows[-1], flush=True)
            shutil.rmtree(place)
    write("two_at_once", {"rows": rows}, _table(rows))


def _table(rows: list[dict[str, object]]) -> Iterator[str]:
    refused = [row for row in rows if "refused" in str(row["outcomes"])]
    yield from (
        "# Two commands at once",
        "",
        f"{len(rows)} pairs on one venue. In {len(refused)} one was refused, and said which one was at "
        "work; in the others both worked. Every calibration and photograph was whole afterwards.",
        "",
        "| command | both worked with | one was refused with |",
        "|---|---|---|",
    )
    for name in COMMANDS:
        of = [row for row in rows if name in str(row["commands"])]
        both, one = (
            [_other(row, name) for row in of if (row in refused) == wanted]
            for wanted in (False, True)
        )
        yield f"| {name} | {', '.join(both)} | {', '.join(one)} |"


def _other(row: dict[str, object], name: str) -> str:
    first, second = row["commands"]  # type: ignore[misc]
    return str(second if first == name else first)
