"""The response of a camera from a folder of bracketed photographs, and a picture of what does not fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray
from procam.errors import CalibrationError
from procam.estimate.camera.response import CameraResponse, solve_response
from procam.files.images.photos import RAW_SUFFIXES, find_bracket, list_photos, read_photo

MARK = (230, 40, 40)  # of places that do not fit
DIM = 0.6  # of the photograph under the marks


@dataclass(frozen=True, slots=True)
class SolvedBrackets:
    """A response, what people should know of it, and its evidence.

    Attributes
    ----------
    names : photographs used. left_out : names of those that do not fit. notes : sentences.
    picture : (H, W, 3) the middle photograph with marks where places do not fit; None if all fit.
    """

    response: CameraResponse
    names: list[str]
    left_out: list[str]
    notes: list[str]
    picture: NDArray[np.uint8] | None


def solve_brackets(
    folder: Path, exposures_s: Sequence[float] = (), *, accept: bool = False
) -> SolvedBrackets:
    """Response of a camera from the photographs in a folder; exposures given or from headers.

    Raises
    ------
    CalibrationError
        What `solve_response` refuses, with the names of the files.
    """
    bracket = find_bracket(folder, exposures_s)
    names = [path.name for path in bracket.paths]
    try:
        found = solve_response(bracket.pixels(), bracket.exposures_s, bracket.bits, accept=accept)
    except CalibrationError as error:
        raise type(error)(f"{folder} ({', '.join(names)}): {error}") from error
    left_out = [names[found.left_out[0]]] if found.left_out else []
    fits = not (found.moved_share or found.overruled)
    order = np.argsort(bracket.exposures_s)
    middle = bracket.paths[int(order[len(order) // 2])]
    return SolvedBrackets(
        found,
        [name for name in names if name not in left_out],
        left_out,
        [*_misfits(found, left_out), *_raw_note(folder)],
        None if fits else _marked(read_photo(middle).pixels, found.moved),
    )


def _misfits(found: CameraResponse, left_out: list[str]) -> list[str]:
    notes = []
    if found.left_out:
        notes.append(f"{left_out[0]} does not fit and is left out; the others agree without it")
    if found.moved_share:
        notes.append(
            f"{found.moved_share:.1%} of the places do not fit, as where something moves, and are left out"
        )
    if found.overruled:
        notes.append(f"accepted although a check refuses it: {found.overruled}")
    return notes


def _raw_note(folder: Path) -> list[str]:
    raw = [name for name in list_photos(folder)[1] if Path(name).suffix.lower() in RAW_SUFFIXES]
    if not raw:
        return []
    return [
        f"{len(raw)} raw files ({raw[0]} ...) lie beside the photographs: raw is linear and needs no "
        'response; develop it to linear 16-bit TIFF and set response = "linear"'
    ]


def _marked(pixels: AnyArray, moved: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The photograph in grey with marks, at the size of the squares."""
    rows, columns = moved.shape
    edge = max(1, min(pixels.shape[0] // rows, pixels.shape[1] // columns))
    cut = pixels[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge, -1)
    grey = cut.mean(axis=(1, 3, 4)) * (DIM * 255 / np.iinfo(pixels.dtype).max)
    picture = np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, axis=2)
    picture[moved] = MARK
    return picture
