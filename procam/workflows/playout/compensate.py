"""`procam compensate`: a picture, numbered pictures, a movie or a pipe through the compensator."""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from glob import escape
from itertools import chain
from math import isnan
from pathlib import Path
from typing import Any, TypeVar

from procam import __version__
from procam.errors import FileFormatError, InputError
from procam.files import atomic
from procam.files.calibration import load_dome
from procam.files.csv_text import csv_text
from procam.files.images.movies import is_movie
from procam.files.images.sequences import Numbered
from procam.files.output_log import OutputLog
from procam.model.calibration import Calibration
from procam.workflows.events import Event, Steps
from procam.workflows.playout.chunks import Chunks, FrameRange, Part
from procam.workflows.playout.frame import ERRORS, ClipEngine, FrameSettings
from procam.workflows.playout.pipeline import flow
from procam.workflows.playout.sources import (
    Clip,
    ClipFrame,
    CompensatedFrame,
    MovieClip,
    Row,
    SequenceClip,
    StillClip,
    keep_note,
    output_names,
    source_sequence,
)

Made = TypeVar("Made")
Named = tuple[str, Path]  # the argument that asks for a file, and the file
FileClip = StillClip | SequenceClip | MovieClip
LOG = "procam.jsonl"
PARTS = ("calibration.json", "maps/dome.exr", "maps/state-*.exr")  # what a compensator reads


@dataclass(frozen=True, slots=True)
class CompensatedClip:
    """Rows of the report by a frame's number, and what became of the first frame's colour profile."""

    rows: dict[int, Row]
    notes: list[str]


def compensate_file(
    calibration_dir: Path,
    source: Path,
    out: Path,
    settings: FrameSettings,
    again: bool = False,
    beside: Sequence[Named] = (),
    frames: FrameRange | None = None,
) -> Steps[CompensatedClip]:
    """Compensate IN to OUT; an event per frame.

    Only `frames`, if they are given; whatever the ranges, all of them together make the same files.
    Pictures of a sequence that an earlier run finished from the same sources with the same calibration and
    settings are skipped, and the result has their rows too; so is a movie, unless `again`. `beside` is
    the files that the caller will write. Nothing starts if a file would overwrite IN or another output.
    """
    clip = open_clip(source, out, calibration_dir, settings, frames)
    refuse_overwriting(clip.read, [*(("OUT", path) for path in clip.written), *beside])
    calibration = load_dome(calibration_dir)
    if isinstance(clip, MovieClip) and clip.is_made and not again:
        yield Event("frames", 0, 0, f"{out} is there already")
        return CompensatedClip({}, [])
    return (yield from compensate_clip(calibration, clip, settings))


def refuse_overwriting(read: Iterable[Path], written: Iterable[Named]) -> None:
    """Refuse a run that would write over what it reads, or over what it has written itself.

    Files are the same if they have one place, whatever it is called, or are one file on the disk.

    Raises
    ------
    InputError
        The first that would be written over.
    """
    resolved = cache(Path.resolve)  # folders: there are few of them, of files there are many

    def marks(path: Path) -> list[object]:
        place: object = (resolved(path.parent), path.name)
        try:
            stat = path.stat()
        except OSError:  # it is not there yet
            return [place]
        return [place, (stat.st_dev, stat.st_ino)]

    taken: dict[object, str] = {mark: "IN itself" for path in read for mark in marks(path)}
    for argument, path in written:
        found = marks(path)
        owner = next((taken[mark] for mark in found if mark in taken), None)
        if owner:
            raise InputError(f"{argument}: {path} is {owner}; choose another name")
        taken |= dict.fromkeys(found, f"a file that {argument} writes already")


def open_clip(
    source: Path,
    out: Path,
    calibration_dir: Path,
    settings: FrameSettings,
    frames: FrameRange | None = None,
) -> FileClip:
    """The clip that IN and OUT name, and the frames still to do."""
    sequence, key = source_sequence(source), run_key(calibration_dir, settings)
    if sequence:
        names = output_names(sequence, out)
        log = OutputLog(
            sequence_log(names.folder, names, frames), key, sequence_logs(names.folder, names)
        )
        return SequenceClip(sequence, names, log, Part(frames, settings.chunks))
    if is_movie(source):
        log = OutputLog(out.with_name(f"{out.name}.{LOG}"), f"{key} {frames or ''}".strip())
        return MovieClip(source, out, log, Part(frames, settings.chunks))
    refuse_range(frames)
    return StillClip(source, out)


def sequence_log(folder: Path, names: Numbered, frames: FrameRange | None = None) -> Path:
    """Where a folder logs what was written in it: sky.procam.jsonl for sky.0001.exr.

    Of a range of frames sky.12-40.procam.jsonl: commands that write into one folder at once have their own.
    """
    parts = [names.before.strip("._- "), str(frames or ""), LOG]
    return folder / ".".join(part for part in parts if part)


def refuse_range(frames: FrameRange | None) -> None:
    """Refuse a range of the frames of one picture."""
    if frames:
        raise InputError(
            "--frames is for numbered pictures and movies; leave it out for one picture"
        )


def sequence_logs(folder: Path, names: Numbered) -> list[Path]:
    """All logs of what was written in a folder: of whole runs, and of ranges."""
    whole = sequence_log(folder, names)
    stem = whole.name.removesuffix(LOG)
    return [whole, *sorted(folder.glob(f"{escape(stem)}*-*.{LOG}"))]


def compensate_clip(
    calibration: Calibration,
    clip: Clip,
    settings: FrameSettings,
    certify: bool = True,
    chunks: Chunks | None = None,
) -> Steps[CompensatedClip]:
    """Compensate all frames of a clip; an event per frame.

    Without `certify` there are no rows: live frames have no end. `chunks` are those of the clip, if not those
    of the settings.
    """
    engine, notes = ClipEngine(calibration, settings, clip.suffix, certify, chunks), list[str]()
    rows, done = dict[int, Row](), 0

    def write(clip_frame: ClipFrame, result: CompensatedFrame) -> None:
        clip.write(clip_frame, result)
        if certify:
            rows[clip_frame.number] = result.row

    with clip:
        rows |= clip.finished
        done = yield from write_frames(clip, engine.make, write, notes)
    if not (done or clip.finished):
        raise FileFormatError("IN: no frame in it; is it the right clip?")
    return CompensatedClip(rows, [*notes, *clip.beyond])


def write_frames(
    clip: Clip,
    make: Callable[[ClipFrame], Made | None],
    write: Callable[[ClipFrame, Made], None],
    notes: list[str],
) -> Steps[int]:
    """Write what `make` makes of each frame of an open clip, None of one that is not wanted; their number.

    `notes` gets what became of the first frame's colour profile.
    """

    def work(clip_frame: ClipFrame) -> Callable[[], str]:
        made = make(clip_frame)
        keep_note(notes, clip_frame.note)
        return partial(_written, clip_frame, made, write)

    done = 0
    yield Event("frames", 0, clip.total, "")
    for done, name in enumerate(filter(None, each_frame(clip, work)), 1):
        yield Event("frames", done, max(clip.total, done), name)
    return done


def _written(
    clip_frame: ClipFrame, made: Made | None, write: Callable[[ClipFrame, Made], None]
) -> str:
    """Name of the frame that was written; "" if none was."""
    if made is None:
        return ""
    write(clip_frame, made)
    return clip_frame.name


def each_frame(clip: Clip, work: Callable[[ClipFrame], Callable[[], Made]]) -> Iterator[Made]:
    """What `work` makes of the frames of an open clip, in their order."""
    reads = iter(clip.reads())
    first = next((job() for job in reads), None)
    if first is None:
        return
    thread_plan = clip.thread_plan(first.rgb.nbytes)
    jobs = chain([_given(first)], reads)
    del first
    yield from flow(jobs, work, thread_plan)


def run_key(calibration_dir: Path, settings: FrameSettings, *more: str) -> str:
    """What makes two runs the same: calibration (with `more` of its files), settings, program."""
    digest = hashlib.sha256(json.dumps([__version__, asdict(settings)]).encode())
    for part in (*PARTS, *more):
        for path in sorted(calibration_dir.glob(part)):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def certified(rows: Sequence[Row]) -> dict[str, Any]:
    """The largest errors over the frames that were checked, and what the checks cover.

    None stands for an error that no frame has: of codes of floats, or where limits hold everywhere.
    """
    checked = [row for row in rows if row.get("checked")]
    covers = sorted({row["checked"] for row in checked})
    found: dict[str, Any] = {"covers": ", ".join(covers), "frames": len(checked)}
    for name in ERRORS:
        values = [row[name] for row in checked if not isnan(row[name])]
        found[name] = max(values, default=None)
    return found


def write_report(path: Path, rows: Sequence[Row]) -> None:
    """Write the clip report: a line of CSV per frame."""
    columns = list(rows[0])
    atomic.write_text(
        path, csv_text([columns, *([row.get(c, "") for c in columns] for row in rows)])
    )


def _given(clip_frame: ClipFrame) -> Callable[[], ClipFrame]:
    return [clip_frame].pop  # hands over the only reference: else it would live as long as the clip
