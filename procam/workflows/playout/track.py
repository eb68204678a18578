"""A folder from which a player compensates a show by itself: numbers per frame, textures, shaders."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from procam.compensate.compensator import Compensator
from procam.compensate.track import METHODS, columns, moves, row, textures, uniforms
from procam.errors import FileFormatError, InputError
from procam.files.atomic import replacing_directory
from procam.files.calibration import load_dome
from procam.files.csv_text import csv_text
from procam.files.images.layers import RGB
from procam.files.images.pixels import write_image
from procam.files.images.stills import square_edge
from procam.model.calibration import Calibration
from procam.workflows.events import Event, Steps
from procam.workflows.playout.chunks import EXACT, ChunkedCompensator
from procam.workflows.playout.frame import (
    FrameSettings,
    named_transfer,
    require_photometry,
    require_standard_canvas,
)
from procam.workflows.playout.pipeline import flow
from procam.workflows.playout.sources import ClipFrame, opened_show

SCHEMA = 1
GLSL = "#version 330 core\n"
LIVE = "#define LIVE\n"
NUMBERS = (
    "scattered light of a colour at a direction is spread times the sum of number times term; x points to "
    "the front, y to the audience's left, z to the pole; columns are TERM.COLOUR, those not there are 0"
)
TEXTURES = {
    "spread": "scattered light for a polynomial of 1 [rel]",
    "lo": "least direct light [rel]",
    "hi": "most direct light [rel]",
    "ambient": "light of the room's own lamps [rel]",
    "gain": "content is multiplied by it after decoding",
    "coverage": "share that projectors reach; black goes out where it is 0",
    "protection": "1 where the content goes out as it came",
    "dither": "thresholds 0..1, added to 8-bit values before they are cut off",
}
NEAREST, REPEAT = ("protection", "dither"), ("dither",)


@dataclass(frozen=True, slots=True)
class Track:
    """What track.json has, and what became of the first frame's colour profile."""

    document: dict[str, Any]
    notes: list[str]


def track_show(
    calibration_dir: Path, source: Path, out: Path, settings: FrameSettings
) -> Steps[Track]:
    """Write OUT for the pictures or the movie `source`; an event per frame.

    OUT appears whole or not at all.

    Raises
    ------
    InputError
        OUT exists; frames of the method differ by more than the numbers; no transfer function.
    FileFormatError
        A frame is no dome master, or not like the first one.
    """
    _check(out, settings.method)
    calibration = load_dome(calibration_dir)
    require_standard_canvas(calibration, "a track", "compensate the show, and play its frames")
    with opened_show(source) as show, replacing_directory(out) as folder:
        first = next(show.reads)()
        if first is None:
            raise InputError(f"IN: no frame in {source}; give a movie or a folder of dome masters")
        with (folder / "track.csv").open("w", newline="", encoding="utf-8") as file:
            rows = _Rows(calibration, first, settings, file)
            reads = chain([lambda: first], show.reads)
            for name in flow(reads, rows.add, show.thread_plan(first.rgb.nbytes)):
                yield Event("track", len(rows.numbers), show.total, name)
        document = _document(rows, settings) | {
            "calibration": {"path": str(calibration_dir), "sha256": _digest(calibration_dir)},
            "show": str(source),
        }
        _write_textures(folder, rows.compensator)
        _write_shaders(folder)
        (folder / "track.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    done = len(rows.numbers)
    yield Event("track", done, done, f"{out} written")
    return Track(document, _notes(first))


def _notes(first: ClipFrame) -> list[str]:
    """What became of the colour profile of the show's first frame."""
    if not first.converted:
        return [first.note] * bool(first.note)
    return [
        f"{first.note}. The player must convert them too, or show frames that were converted before: the "
        "shader takes what it gets as sRGB's"
    ]


class _Rows:
    """Writes a row of numbers per frame.

    Attributes
    ----------
    compensator : of all frames. transfer, dtype : how their pixels are encoded.
    used : how many of the nine numbers per colour are written. numbers : of the frames so far.
    """

    def __init__(
        self, calibration: Calibration, first: ClipFrame, settings: FrameSettings, file: TextIO
    ) -> None:
        require_photometry(calibration)
        self.transfer, self.dtype = named_transfer(first, settings), first.rgb.dtype
        self.compensator = Compensator(
            calibration,
            square_edge(first.rgb, first.name),
            settings.method,
            settings.state,
            white=settings.white,
            transfer_name=self.transfer,
        )
        self._chunks = ChunkedCompensator(lambda: self.compensator, EXACT)
        self.used = self.compensator.fields.model.terms
        self.numbers: list[int] = []
        self._settings, self._out = settings, np.empty_like(first.rgb)
        self._table = file
        self._table.write(csv_text([["frame", *columns(self.used)]]))

    def add(self, clip_frame: ClipFrame) -> Callable[[], str]:
        """Solve a frame, which must be like the first one; returns a call that gives its name."""
        name, rgb = clip_frame.name, clip_frame.rgb
        found = square_edge(rgb, name), rgb.dtype, named_transfer(clip_frame, self._settings)
        if found != (expected := (self.compensator.size, self.dtype, self.transfer)):
            raise FileFormatError(
                f"{name}: {_worded(*found)}, but the first frame has {_worded(*expected)}; render "
                "all frames alike"
            )
        solved = self._chunks.solve(clip_frame.number, rgb, self._out)
        numbers = row(solved.coefficients, self.used)
        self._table.write(csv_text([[clip_frame.number, *(f"{v:.9g}" for v in numbers)]]))
        self.numbers.append(clip_frame.number)
        return lambda: name


def _worded(size: int, dtype: np.dtype[Any], transfer: str) -> str:
    return f"{size} px of {dtype} in {transfer}"


def _check(out: Path, method: str) -> None:
    if method not in METHODS:
        raise InputError(
            f"--method: no track for {method!r}; choose {' or '.join(METHODS)}. Frames of other "
            "methods differ by more than a track can hold"
        )
    if out.exists():
        raise InputError(f"OUT: {out} exists; give the name of a new folder")


def _document(rows: _Rows, settings: FrameSettings) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "procam": version("procam"),
        "size": rows.compensator.size,
        "field_size": rows.compensator.fields.model.nodes,
        "content_type": str(rows.dtype),
        "method": settings.method,
        "state": settings.state,
        "white": settings.white,
        "transfer": rows.transfer,
        "uniforms": uniforms(rows.transfer, rows.dtype),
        "frames": {"count": len(rows.numbers), "first": rows.numbers[0], "last": rows.numbers[-1]},
        "numbers": {"file": "track.csv", "columns": columns(rows.used), "meaning": NUMBERS},
        "textures": {
            name: {
                "file": f"{name}.exr",
                "filter": "nearest" if name in NEAREST else "linear",
                "wrap": "repeat" if name in REPEAT else "clamp",
                "meaning": meaning,
            }
            for name, meaning in TEXTURES.items()
        },
    }


def _write_textures(folder: Path, compensator: Compensator) -> None:
    for name, pixels in textures(compensator.fields).items():
        write_image(folder / f"{name}.exr", pixels, RGB if pixels.shape[2] == 3 else ("Y",))
    write_image(folder / "live" / "moves.exr", moves(compensator.fields), RGB)


def _write_shaders(folder: Path) -> None:
    """The programs, each whole in its file."""
    parts = resources.files("procam.compensate") / "shader"
    dome, compensate, reduce, solve = (
        (parts / name).read_text("utf-8")
        for name in ("dome.glsl", "compensate.frag", "reduce.frag", "solve.frag")
    )
    programs = {
        "compensate.frag": [dome, compensate],
        "live/apply.frag": [LIVE, dome, compensate],
        "live/reduce.frag": [LIVE, dome, reduce],
        "live/solve.frag": [solve],
    }
    for name, sources in programs.items():
        (folder / name).write_text("\n".join([GLSL.rstrip(), *sources]), encoding="utf-8")
    (folder / "README.txt").write_text((parts / "README.md").read_text("utf-8"), encoding="utf-8")


def _digest(calibration_dir: Path) -> str:
    """Of all files of a calibration."""
    digest = hashlib.sha256()
    for path in sorted(path for path in calibration_dir.rglob("*") if path.is_file()):
        digest.update(path.relative_to(calibration_dir).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
