"""The response of a projector from a folder of photographs of flat grey levels."""

import re
from collections.abc import Sequence
from pathlib import Path

from procam.errors import CalibrationError, FileFormatError
from procam.estimate.light.gamma_set import fit_gamma_set
from procam.files.images.photos import list_photos, load_response, photo_light, read_photo
from procam.model.photometry import ResponseCurve

TOP_DRIVE = 255


def solve_gamma_set(folder: Path, camera: str, drives: Sequence[int] = ()) -> ResponseCurve:
    """Response of a projector from photographs whose names end in the drive, unless `drives` are given.

    Parameters
    ----------
    camera : how the camera encodes light: "linear", "srgb" or a CSV of `procam response`.

    Raises
    ------
    FileFormatError
        A photograph without a drive, or several exposures.
    CalibrationError
        What `fit_gamma_set` refuses.
    """
    paths, _ = list_photos(folder)
    if drives and len(drives) != len(paths):
        raise FileFormatError(
            f"{folder}: {len(drives)} levels were given for {len(paths)} photographs; give one for each, in "
            f"this order: {', '.join(path.name for path in paths)}"
        )
    response, shown = load_response(camera, Path()), drives or [_drive(path) for path in paths]
    exposures = {path: read_photo(path).exposure_s for path in paths}
    if len({value for value in exposures.values() if value is not None}) > 1:
        raise FileFormatError(
            f"{folder}: the exposures differ "
            f"({', '.join(f'{path.name} {value:g} s' for path, value in exposures.items() if value)}); "
            "photograph all levels at one exposure"
        )
    try:
        return fit_gamma_set((photo_light(read_photo(path), response) for path in paths), shown)
    except CalibrationError as error:
        raise type(error)(f"{folder}: {error}") from error


def _drive(path: Path) -> int:
    """The drive at the end of a name such as grey_128.png."""
    found = re.search(r"(\d+)$", path.stem)
    if not found or int(found[1]) > TOP_DRIVE:
        raise FileFormatError(
            f"{path}: its name must end in the level shown, 0 to {TOP_DRIVE}, such as grey_128.png; or give "
            "all levels with --levels"
        )
    return int(found[1])
