"""An open data set: capture sessions of simulated domes, and the truth about each dome.

`python -m studies.dataset OUT` writes it: bundles of sessions, truth in the calibration-directory format,
dataset.json with the sha256 of every file, a README and the licence. `procam.load_dataset` reads it. Two
runs give the same bytes.
"""

import json
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path

from procam.errors import ProcamError
from procam.files.atomic import replacing_directory
from procam.files.bundle.manifest import FileEntry
from procam.files.bundle.write import writing_bundle
from procam.files.dataset import INDEX, SCHEMA, DatasetIndex, SessionEntry
from procam.files.history.store import file_digest
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.workflows.capture.capture import capture, prepare_session
from procam.workflows.venue_rig import open_rig
from simulators.scene import SceneSize
from simulators.template import room_text, venue_text
from simulators.truth import write_truth

README = Path(__file__).with_name("dataset_readme.md")
COMMAND = "python -m studies.dataset OUT"
RoomText = Callable[[SceneSize, int], str]  # venue.toml of a size and a seed
ROOMS: Mapping[str, RoomText] = {
    "standard": partial(venue_text, "standard"),
    "realistic": partial(venue_text, "realistic"),
    "room-4": partial(room_text, 4),
}
SEEDS = range(1, 4)
SIZE = SceneSize(projector_size=(640, 400), camera_size=(800, 800))
LICENSE = """\
Data set of simulated projection domes, made by procam.

This work is licensed under the Creative Commons Attribution 4.0 International License (CC BY 4.0,
SPDX-License-Identifier: CC-BY-4.0). You may share and adapt it for any purpose, also commercially, if you
give credit, link to the licence and say what you changed. The whole text:
https://creativecommons.org/licenses/by/4.0/legalcode
"""


def make_dataset(
    out: Path,
    rooms: Mapping[str, RoomText] = ROOMS,
    seeds: Iterable[int] = SEEDS,
    size: SceneSize = SIZE,
) -> None:
    """Write the data set to `out`, which must not exist."""
    with replacing_directory(out) as folder:
        frames = dict[SessionEntry, int]()
        for room, text in rooms.items():
            for seed in seeds:
                entry = SessionEntry(name=f"{room}-{seed}", room=room, seed=seed)
                frames[entry] = _add_session(folder, entry, text(size, seed))
                print(f"{entry.name}: {frames[entry]} photographs", flush=True)
        (folder / "README.md").write_text(_readme(frames, size), encoding="utf-8")
        (folder / "LICENSE.txt").write_text(LICENSE, encoding="utf-8")
        (folder / INDEX).write_text(_index(folder, frames), encoding="utf-8")


def _add_session(folder: Path, entry: SessionEntry, venue_toml: str) -> int:
    """Capture a session, write its bundle and, once per room, the truth; the number of its photographs."""
    with tempfile.TemporaryDirectory() as work:
        directory = Path(work)
        (directory / "venue.toml").write_text(venue_toml, encoding="utf-8")
        venue = load_venue(directory)
        session = prepare_session(venue, directory / "sessions" / "0001")
        with open_rig(venue) as rig:
            for _ in capture(rig, venue, session):
                pass
        manifest = result_of(writing_bundle(venue, session, folder / entry.bundle))
        if not (folder / entry.truth).exists():
            write_truth(venue.backends["simulated"], directory, folder / entry.truth, {})
        return manifest.frames


def _readme(frames: Mapping[SessionEntry, int], size: SceneSize) -> str:
    rows = (f"| `{s.name}` | {s.room} | {s.seed} | {count} |" for s, count in frames.items())
    return README.read_text("utf-8").format(
        rows="\n".join(rows),
        projector="x".join(map(str, size.projector_size)),
        camera="x".join(map(str, size.camera_size)),
        version=version("procam"),
        command=COMMAND,
    )


def _index(folder: Path, sessions: Iterable[SessionEntry]) -> str:
    files = {
        path.relative_to(folder).as_posix(): FileEntry(
            bytes=path.stat().st_size, sha256=file_digest(path)
        )
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    index = DatasetIndex(
        schema_version=SCHEMA,
        procam=version("procam"),
        license="CC-BY-4.0",
        command=COMMAND,
        sessions=list(sessions),
        files=files,
    )
    return json.dumps(index.model_dump(), indent=1) + "\n"


def main(arguments: list[str]) -> int:
    """Write the data set; 2 for wrong arguments."""
    if len(arguments) != 1 or Path(arguments[0]).exists():
        print(f"{COMMAND}: OUT is a folder that does not exist yet", file=sys.stderr)
        return 2
    try:
        make_dataset(Path(arguments[0]))
    except ProcamError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
