"""Shows as pictures what compensation does to one frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procam.arrays import Image
from procam.compensate.compensator import Compensator
from procam.errors import FileFormatError
from procam.files.images.layers import RGB, write_channels
from procam.files.images.movies import MovieReader, is_movie
from procam.files.images.stills import square_edge
from procam.model.calibration import Calibration
from procam.workflows.playout.encodings import decoded
from procam.workflows.playout.frame import (
    FrameSettings,
    linear_compensator,
    most_light,
    named_transfer,
)
from procam.workflows.playout.sources import (
    ClipFrame,
    movie_clip_frame,
    read_clip_frame,
    source_sequence,
)


@dataclass(frozen=True, slots=True)
class Explained:
    """One frame, all (N, N, 3) linear light [rel] on its own dome master.

    Attributes
    ----------
    content : what is asked for. without : what would be seen of it without compensation.
    scattered : the scattered light in `without`. direct : what is sent instead.
    observed : what will be seen of that.
    limits : 0 where no limit holds: `observed` is the content under its white (or what a perceptual
        method chose), 1 where even black is too bright, -1 where even white is too dark; NaN where nothing
        is lit and where a person protects the content.
    """

    content: Image
    without: Image
    scattered: Image
    direct: Image
    observed: Image
    limits: Image


def first_frame(source: Path) -> ClipFrame:
    """The first frame of what IN names."""
    sequence = source_sequence(source)
    if sequence:
        return read_clip_frame(sequence.names.path(sequence.numbers[0]))
    if not is_movie(source):
        return read_clip_frame(source)
    with MovieReader(source) as reader:
        frame = next(iter(reader), None)
        if frame is None:
            raise FileFormatError(f"{source}: no frame in it; is it the right clip?")
        return movie_clip_frame(reader, frame, 0)


def explain(calibration: Calibration, clip_frame: ClipFrame, settings: FrameSettings) -> Explained:
    """Solve a frame with (in full, whatever the strength) and without compensation, in linear light."""
    size = square_edge(clip_frame.rgb, clip_frame.name)
    content = decoded(clip_frame.rgb, named_transfer(clip_frame, settings))
    ours = linear_compensator(calibration, size, settings, settings.checked_method())
    plain = Compensator(calibration, size, "none", settings.state, transfer_name="linear")
    found, without = (each.predict(content, most_light(clip_frame.rgb)) for each in (ours, plain))
    limits = np.sign(found.observed - ours.target(content))
    limits[found.free] = 0
    limits[~ours.lit | ours.protected] = np.nan
    return Explained(
        content,
        without.observed,
        without.observed - without.direct,
        found.direct,
        found.observed,
        limits.astype(np.float32),
    )


def picture_files(folder: Path) -> dict[str, Path]:
    """FOLDER/NAME.exr by name, one for each picture."""
    return {name: folder / f"{name}.exr" for name in Explained.__slots__}


def write_pictures(folder: Path, explained: Explained) -> None:
    """Write FOLDER/NAME.exr, one for each picture."""
    for name, path in picture_files(folder).items():
        picture = getattr(explained, name)
        write_channels(path, {c: picture[..., i] for i, c in enumerate(RGB)})
