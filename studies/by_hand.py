"""A dome that people drive, from `procam init` to a refined calibration and a measured audience.

The photographs are made by a process that gets the pictures and the orders and nothing else
(tests/workflow/photographer.py); the commands are those that procam names from step to step. Writes
studies/by_hand.json and studies/by_hand.md; `python -m studies by-hand` remakes them in minutes.
"""

import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from procam.files.calibration import load_calibration
from simulators.scene import SceneSize
from simulators.template import venue_text
from studies.full_disk import PATHS, TESTS
from studies.measure import write
from studies.stops import ONE_THREAD

PHOTOGRAPHER = TESTS / "workflow" / "photographer.py"
SIZE = SceneSize(projectors=2, projector_size=(640, 400), camera_size=(900, 900), rays=512)
PEOPLE = 0.2  # albedo of a floor with an audience
TESTED = ("dark", "white", "black")  # and two stripes, in the photographs for `doctor`
MOST_ROUNDS = 12
NOT_OURS = ("backend = ", "control = ")  # lines of the simulated venue.toml


@dataclass
class People:
    """What people do in a folder; `said` is what stood on their screen."""

    folder: Path
    said: list[str] = field(default_factory=list)
    cards: int = 0

    def run(self, *arguments: str) -> str:
        """Type a command; its output. Raises AssertionError if it fails."""
        done = subprocess.run(
            (sys.executable, "-m", "procam", *arguments),
            cwd=self.folder,
            env=os.environ | ONE_THREAD | {"PYTHONPATH": PATHS},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in {0, 1}, (arguments, done.stderr)
        self.said += [f"$ procam {' '.join(arguments)}", *done.stdout.splitlines(), ""]
        return done.stdout

    def photograph(self, pictures: str, floor: str = "") -> str:
        """Photograph what an order asks for; the folder of the photographs."""
        self.cards += 1
        photos = f"card-{self.cards}"
        self.say(
            f"show and photograph {pictures} in its order, and copy the photographs to {photos}"
        )
        subprocess.run(
            (
                sys.executable,
                str(PHOTOGRAPHER),
                "elsewhere",
                pictures,
                photos,
                *filter(None, [floor]),
            ),
            cwd=self.folder,
            env=os.environ
            | ONE_THREAD
            | {"PYTHONPATH": os.pathsep.join((PATHS, str(TESTS / "workflow")))},
            check=True,
        )
        return photos

    def say(self, text: str) -> None:
        """Note what people do."""
        self.said += [f"# {text}", ""]

    def rounds(self, *command: str, floor: str = "") -> int:
        """Run a command and photograph until it has what it needs; the number of rounds."""
        out = self.run(*command)
        for number in range(MOST_ROUNDS):
            if "are needed, in this order" not in out:
                return number
            work = next(line for line in out.splitlines() if line.startswith("then: "))
            assert work == f"then: procam {' '.join(command)} --photos FOLDER", work
            pictures = str(Path(out.partition("/pictures has")[0].splitlines()[-1]))
            out = self.run(*command, "--photos", self.photograph(pictures, floor))
        raise AssertionError(f"{command}: more than {MOST_ROUNDS} rounds")


def play(folder: Path) -> tuple[People, dict[str, object]]:
    """The whole of it in a folder, and its figures."""
    people, simulated = People(folder), venue_text("standard", SIZE)
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "venue.toml").write_text(simulated)
    people.run("init", "my-dome", "--template", "by-hand")
    people.say("write the dome's own figures into my-dome/venue.toml")
    lines = simulated.partition("[simulated]")[0].splitlines()
    own = "\n".join(line for line in lines if not line.startswith(NOT_OURS)) + "\n"
    (folder / "my-dome" / "venue.toml").write_text(own)
    people.run("session", "plan", "my-dome", "pictures")
    roll = people.photograph("pictures")
    _test_photographs(folder / "pictures", folder / roll, folder / "test")
    people.say(
        "(before that roll, a few of its pictures were photographed as a test, in folder test)"
    )
    people.run("doctor", "my-dome", "--camera", "zenith", "--photos", "test")
    session = "my-dome/sessions/hand-0001"
    people.run("session", "add", session, "--camera", "zenith", "--photos", roll)
    people.run("session", "solve", session)
    rounds = people.rounds("refine", "my-dome")
    people.run("report", "my-dome")
    people.say("the audience is in")
    people.rounds("state", "my-dome", "full", floor=f"{PEOPLE:g}")
    used = sorted((folder / "my-dome" / "calibrations").iterdir())[-1]
    state = load_calibration(used).states["full"]
    ratio = [round(float(r), 4) for r in state.scatter_ratio]
    return people, {
        "rounds_of_refine": rounds,
        "scatter_ratio_full": ratio,
        "calibration": used.name,
    }


def _test_photographs(pictures: Path, roll: Path, out: Path) -> None:
    """Copy the dark, and of each projector white, black and two stripes."""
    out.mkdir()
    stripes = dict[str, int]()
    entries = csv.DictReader((pictures / "order.csv").read_text("utf-8").splitlines())
    for number, entry in enumerate(entries):
        name, purpose = entry["projector"], entry["purpose"]
        stripes[name] = stripes.get(name, 0) + (purpose == "stripes")
        if purpose in TESTED or (purpose == "stripes" and stripes[name] <= 2):
            for path in roll.glob(f"{number}_*"):
                shutil.copy(path, out)


def main() -> None:
    """Play it and write studies/by_hand.json and .md."""
    with tempfile.TemporaryDirectory() as folder:
        people, figures = play(Path(folder))
    print(json.dumps(figures), flush=True)
    write("by_hand", figures, _table(people, figures))


def _table(people: People, figures: dict[str, object]) -> Iterator[str]:
    yield from (
        "# By hand, from beginning to end",
        "",
        f"{figures['rounds_of_refine']} rounds of `refine`; with people the scattered light is "
        f"{figures['scatter_ratio_full']} of that without. Photographs are those of a simulated dome.",
        "",
        "```text",
        *people.said,
        "```",
    )
