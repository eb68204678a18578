"""From dome masters to what each projector is sent."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from procam.compensate.any_screen import AnyCompensator
from procam.compensate.projector_frames import Warper
from procam.errors import FileFormatError, InputError
from procam.files.calibration import load_calibration
from procam.files.images.movie_writer import MovieWriter, new_movie
from procam.files.images.movies import MovieFrame, is_movie
from procam.files.images.pixels import write_image
from procam.files.images.sequences import Numbered, PictureSequence
from procam.files.output_log import OutputLog
from procam.model.calibration import Calibration
from procam.workflows.events import Steps
from procam.workflows.playout.chunks import ChunkedCompensator, FrameRange, Part
from procam.workflows.playout.compensate import (
    LOG,
    refuse_overwriting,
    refuse_range,
    run_key,
    sequence_log,
    sequence_logs,
    write_frames,
)
from procam.workflows.playout.encodings import decoded
from procam.workflows.playout.frame import (
    FrameSettings,
    canvas_size,
    linear_compensator,
    named_transfer,
    require_photometry,
)
from procam.workflows.playout.sources import (
    ClipFrame,
    MovieClip,
    SequenceClip,
    StillClip,
    source_sequence,
)

Frames = Mapping[str, NDArray[np.uint16]]
MAPS = "maps/*.exr"  # a warp needs every projector's


@dataclass(frozen=True, slots=True)
class ProjectorFrames:
    """What was written, and what became of the first frame's colour profile."""

    paths: list[str]
    notes: list[str]


def warp_file(
    calibration_dir: Path,
    source: Path,
    out: Path,
    settings: FrameSettings,
    frames: FrameRange | None = None,
) -> Steps[ProjectorFrames]:
    """Write each projector's frames of a clip under OUT, 16 bits, compensated in linear light on the way.

    Only `frames` of it, if they are given. Direct light keeps its values by method "none".
    OUT/PROJECTOR.png of a picture, OUT/PROJECTOR/NAME.png of numbered pictures (those that an earlier run has
    finished are skipped), OUT/PROJECTOR.mov or .mkv of a movie. An event per frame.
    """
    calibration = load_calibration(calibration_dir)
    require_photometry(calibration)
    if not calibration.projectors:
        raise InputError(
            "CALIBRATION has no projectors, so there is nothing to warp to; behind a media server play the "
            "dome master itself"
        )
    part = Part(frames, settings.chunks)
    clip = _open(calibration_dir, calibration, (source, out), settings, part)
    refuse_overwriting(clip.read, (("OUT", path) for path in clip.written))
    maker, notes = _Maker(calibration, settings), list[str]()
    with clip:
        yield from write_frames(clip, maker.frames, clip.write_frames, notes)
    return ProjectorFrames(clip.paths, [*notes, *clip.beyond])


class _Maker:
    """Makes projector frames of the frames of a clip, which are all of the first one's size."""

    def __init__(self, calibration: Calibration, settings: FrameSettings) -> None:
        self._calibration, self._settings = calibration, settings
        self._warper: Warper | None = None  # known by the first frame; preparing it takes seconds
        self._chunks = ChunkedCompensator(self._compensator, settings.chunks)

    def frames(self, clip_frame: ClipFrame) -> Frames | None:
        """A frame (H, W, 3) of each projector; None of one that only precedes those that are wanted."""
        size = canvas_size(clip_frame.rgb, clip_frame.name, self._calibration)
        name = named_transfer(clip_frame, self._settings)
        if self._warper is None:
            self._warper = Warper(self._calibration, size, np.uint16)
        if size != self._warper.size:
            raise FileFormatError(
                f"{clip_frame.name}: {size} px, but the first frame has {self._warper.size}; render all "
                "frames in one size"
            )
        content = decoded(clip_frame.rgb, name)
        direct = self._chunks.solve(clip_frame.number, content).sent
        return self._warper.frame(direct) if clip_frame.wanted else None

    def _compensator(self) -> AnyCompensator:
        assert self._warper is not None
        method = self._settings.checked_method()
        return linear_compensator(self._calibration, self._warper.size, self._settings, method)


def _open(
    calibration_dir: Path,
    calibration: Calibration,
    files: tuple[Path, Path],
    settings: FrameSettings,
    part: Part,
) -> "_WarpedStill | _WarpedSequence | _WarpedMovie":
    (source, out), names = files, list(calibration.projectors)
    sequence = source_sequence(source)
    if sequence:
        key = run_key(calibration_dir, settings, MAPS)
        others = sequence_logs(out, sequence.names)
        log = OutputLog(sequence_log(out, sequence.names, part.frames), key, others)
        return _WarpedSequence(sequence, out, names, log, part)
    if is_movie(source):
        return _WarpedMovie(source, out, calibration, part)
    refuse_range(part.frames)
    return _WarpedStill(source, out, names)


class _WarpedStill(StillClip):
    def __init__(self, source: Path, out: Path, names: list[str]) -> None:
        super().__init__(source, out / "projector.png")
        self._paths = {name: out / f"{name}.png" for name in names}
        self.written = list(self._paths.values())
        self.paths = [str(path) for path in self.written]

    def write_frames(self, clip_frame: ClipFrame, frames: Frames) -> None:
        for name, pixels in frames.items():
            write_image(self._paths[name], pixels)


class _WarpedSequence(SequenceClip):
    def __init__(
        self, sequence: PictureSequence, out: Path, names: list[str], log: OutputLog, part: Part
    ) -> None:
        source = sequence.names
        after = f"{source.after.removesuffix(source.suffix)}.png"
        self._outs = {n: Numbered(out / n, source.before, source.digits, after) for n in names}
        self.paths = [str(numbered) for numbered in self._outs.values()]
        super().__init__(sequence, self._outs[names[-1]], log, part)
        self.written = [o.path(n) for o in self._outs.values() for n in sequence.numbers]
        self.written.append(log.path)

    def is_whole(self, number: int, row: dict[str, Any]) -> bool:
        """Whether every projector's frame is there; the log knows the size of the last one only."""
        sizes = row.get("sizes", {})
        paths = {name: outs.path(number) for name, outs in self._outs.items()}
        return all(p.is_file() and p.stat().st_size == sizes.get(n) for n, p in paths.items())

    def write_frames(self, clip_frame: ClipFrame, frames: Frames) -> None:
        sizes = {}
        for name, pixels in frames.items():
            path = self._outs[name].path(clip_frame.number)
            write_image(path, pixels)
            sizes[name] = path.stat().st_size
        state, _ = clip_frame.source_data
        self.log.add(path, state, {"sizes": sizes})


class _WarpedMovie(MovieClip):
    def __init__(self, source: Path, out: Path, calibration: Calibration, part: Part) -> None:
        suffix = ".mkv" if source.suffix == ".mkv" else ".mov"
        self._sizes = {n: p.model.size for n, p in calibration.projectors.items()}
        self._paths = {name: out / f"{name}{suffix}" for name in self._sizes}
        self.paths = [str(path) for path in self._paths.values()]
        self._writers: dict[str, MovieWriter] = {}
        super().__init__(source, out / f"projector{suffix}", OutputLog(out / LOG, ""), part)
        self.written = list(self._paths.values())

    def write_frames(self, clip_frame: ClipFrame, frames: Frames) -> None:
        if not self._writers:
            for name, path in self._paths.items():
                movie = new_movie(
                    path, self.reader, transfer="", size=self._sizes[name], layout="rgb48le"
                )
                self._writers[name] = self.stack.enter_context(movie)
        frame: MovieFrame = replace(clip_frame.source_data, alpha=None)
        for name, pixels in frames.items():
            self._writers[name].write(pixels, frame)
