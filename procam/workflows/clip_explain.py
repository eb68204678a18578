"""What compensation does to one frame, as pictures."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.compensate.exact import Compensator
from procam.errors import FileFormatError
from procam.files.images import RGB, write_channels
from procam.files.movie_clips import MovieReader, is_movie
from procam.model.calibration import Calibration
from procam.workflows.clip_ends import Piece, read_piece, source_sequence
from procam.workflows.clip_engine import How, decoded, named_transfer, square_edge

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Explained:
    """One frame, all (N, N, 3) linear light [rel] on its own dome master.

    Attributes
    ----------
    content : what is asked for. without : what would be seen of it without compensation.
    scattered : the light in `without` that bounced. direct : what is sent instead.
    observed : what will be seen of that.
    limits : 0 where `observed` is the content, 1 where even black is too bright, -1 where even white
        is too dark; NaN where nothing is lit.
    """

    content: Image
    without: Image
    scattered: Image
    direct: Image
    observed: Image
    limits: Image


def first_piece(source: Path) -> Piece:
    """The first frame of what IN names."""
    sequence = source_sequence(source)
    if sequence:
        return read_piece(sequence.names.path(sequence.numbers[0]))
    if not is_movie(source):
        return read_piece(source)
    with MovieReader(source) as reader:
        frame = next(iter(reader), None)
        if frame is None:
            raise FileFormatError(f"{source}: got no frame, expected one or more")
        return Piece(0, f"frame 0 of {source}", frame.rgb, reader.transfer)


def explain(calibration: Calibration, piece: Piece, how: How) -> Explained:
    """Solve a frame with and without compensation, in linear light."""
    size = square_edge(piece)
    content = decoded(piece.rgb, named_transfer(piece, how))
    options = {"strength": how.strength, "white": how.white, "transfer_name": "linear"}
    ours = Compensator(calibration, size, how.method, how.state, **options)  # type: ignore[arg-type]
    plain = Compensator(calibration, size, "none", how.state, **options)  # type: ignore[arg-type]
    found, without = ours.solve(content), plain.solve(content)
    limits = np.sign(found.observed - content)
    limits[found.free] = 0
    lit = without.observed.any(axis=-1, keepdims=True)
    return Explained(
        content,
        without.observed,
        without.observed - without.direct,
        found.direct,
        found.observed,
        np.where(lit, limits, np.nan).astype(np.float32),
    )


def write_pictures(folder: Path, explained: Explained) -> None:
    """Write FOLDER/NAME.exr, one for each picture."""
    for name in Explained.__slots__:
        picture = getattr(explained, name)
        write_channels(folder / f"{name}.exr", {c: picture[..., i] for i, c in enumerate(RGB)})
