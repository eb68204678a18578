"""The Python interface: the commands' work as functions of plain arguments and arrays.

`import procam` exports these lazily, with the models and the errors. Workflows yield events
while they run; here they run to their end, and the result is returned.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray
from procam.errors import InputError, NotEnoughData
from procam.estimate.boards.camera import BoardView, CameraFit, fit_camera
from procam.estimate.boards.targets import Board, find_board
from procam.estimate.camera.exposure import green
from procam.estimate.structured_light import codes
from procam.estimate.structured_light.decode import Decoder
from procam.estimate.structured_light.limits import default_limits
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.generators import result_of
from procam.maths.geometry.lenses import LensKind
from procam.model.calibration import Calibration
from procam.model.correspondence import CorrespondenceMap
from procam.workflows.capture.newest import capture_newest, venue_of
from procam.workflows.solve import calibrate

REVERSED_SHARE = 0.01  # of the pixels, in which black may be brighter than white: a moving thing
CHANNELS = (), (1,), (3,), (4,)  # of photographs: grey, colour, with alpha


def generate_patterns(
    size: tuple[int, int], code: str = codes.DEFAULT_CODE
) -> list[NDArray[np.uint8]]:
    """Patterns of a structured-light code, to be shown full screen in this order.

    Parameters
    ----------
    size : (width, height) of the projector [px].
    code : "micro-phase", "phase-heterodyne" or "gray".

    Returns
    -------
    patterns : (height, width) each, encoded for a display gamma of 2.2; white and black come first, also
        of "gray", which `procam lens patterns` writes last.

    Raises
    ------
    InputError
        If the code is unknown or the projector too small for it.

    Examples
    --------
    >>> patterns = generate_patterns((128, 80))
    >>> len(patterns), patterns[0].shape, int(patterns[0].min())
    (18, (80, 128), 255)
    """
    made = codes.make_code(code, _checked_size(size))
    return [picture[..., 0] for picture in codes.generate(made)]


def decode(
    photographs: Iterable[AnyArray], size: tuple[int, int], code: str = codes.DEFAULT_CODE
) -> CorrespondenceMap:
    """Projector coordinates of every camera pixel, from photographs of `generate_patterns`.

    Parameters
    ----------
    photographs : (H, W) or (H, W, C) each, uint8, uint16 or float32, linear, one per pattern in the
        order of `generate_patterns`. They are folded in one by one, so a generator keeps memory flat.
    size : (width, height) of the projector [px].
    code : as for `generate_patterns`.

    Returns
    -------
    correspondence : projector_xy (H, W, 2) and sigma_px (H, W, 2) [px], NaN where `valid` is false.

    Raises
    ------
    InputError, NotEnoughData
        Photographs of different sizes; more or fewer of them than patterns.

    Examples
    --------
    >>> found = decode(generate_patterns((128, 80)), (128, 80))
    >>> bool(found.valid.mean() > 0.9)
    True
    """
    decoder = Decoder(codes.make_code(code, _checked_size(size)))
    planes, count, levels = len(decoder.code.planes), 0, list[AnyArray]()
    for photograph in photographs:
        if count == planes:
            raise InputError(
                f"decode: the code {code} has {planes} patterns, and there are more photographs"
            )
        picture = _grey(photograph)
        if count < 2:
            levels.append(picture)
        if count == 1:
            _check_order(*levels)
        decoder.add(count, picture)
        count += 1
    if count < planes:
        raise NotEnoughData(
            f"decode: the code {code} has {planes} patterns, and there are {count} photographs; take one "
            "of each"
        )
    return decoder.result().map


def calibrate_camera(
    photographs: Sequence[AnyArray],
    squares: tuple[int, int],
    square_m: float,
    model: LensKind = "brown",
) -> CameraFit:
    """Intrinsics of a camera from photographs of a checkerboard.

    Parameters
    ----------
    photographs : (H, W) or (H, W, C) each, of one size; those that do not show the board are left out.
    squares : along both edges of the board, the outermost included.
    square_m : edge of a square [m].
    model : "brown" (pinhole) or "kannala-brandt" (fisheye).

    Returns
    -------
    fit : `fit.lens`, `fit.sigma` (standard errors by name) and residuals [px].

    Raises
    ------
    InputError, NotEnoughData
        No photographs or several sizes; fewer than three views, or all boards parallel.

    Examples
    --------
    >>> import numpy as np
    >>> calibrate_camera([np.zeros((90, 120), np.uint8)] * 3, (10, 7), 0.02)
    Traceback (most recent call last):
    procam.errors.NotEnoughData: ...
    """
    board = Board("checkerboard", squares, square_m)
    grey = [_grey(photograph) for photograph in photographs]
    sizes = {picture.shape[::-1] for picture in grey}
    if len(sizes) != 1:
        raise InputError(
            f"calibrate_camera: the photographs have {len(sizes)} sizes; give one or more of one size."
        )
    found = ((i, find_board(p, board)) for i, p in enumerate(grey))
    views = [BoardView(f"photograph {i}", *corners) for i, corners in found if corners]
    if not views:
        raise NotEnoughData(
            f"calibrate_camera: no photograph shows a board of {squares[0]}x{squares[1]} squares; "
            "count squares, not corners."
        )
    return fit_camera(views, sizes.pop(), model)


def capture(venue: str | Path) -> Path:
    """Show and photograph all patterns of a venue; resumes an unfinished session.

    Parameters
    ----------
    venue : folder with a venue.toml.

    Returns
    -------
    session : folder of the capture session, for `solve`.

    Raises
    ------
    InputError, DeviceError
        A mistake in venue.toml; a device that fails.

    Examples
    --------
    >>> capture("/nowhere")
    Traceback (most recent call last):
    procam.errors.InputError: ...
    """
    return result_of(capture_newest(load_venue(Path(venue)))).directory


def solve(session: str | Path) -> Calibration:
    """Calibrate from a capture session; the calibration is also stored beside it.

    Parameters
    ----------
    session : folder VENUE/sessions/NAME.

    Returns
    -------
    calibration : stored as the venue's newest, VENUE/calibrations/NNNN.

    Raises
    ------
    InputError, CalibrationError
        Missing or damaged captures; captures that do not determine the result.

    Examples
    --------
    >>> solve("/nowhere/sessions/0001")
    Traceback (most recent call last):
    procam.errors.InputError: ...
    """
    directory = Path(session)
    solved = result_of(calibrate.solve(load_venue(venue_of(directory)), Session(directory)))
    return load_calibration(solved.directory)


def _check_order(white: AnyArray, black: AnyArray) -> None:
    """Refuse other pictures in the places of white and black: stripes are darker than their inverse."""
    if white.shape != black.shape:
        return  # refused by the decoder
    darker = np.subtract(black, white, dtype=np.float32) > default_limits(white, black).white_black
    share = float(np.mean(darker))
    if share > REVERSED_SHARE:
        raise InputError(
            f"white, the first photograph, is darker than black, the second, in {share:.0%} of the pixels; "
            "give white, then black, then the code"
        )


def _checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of a projector."""
    whole = np.asarray(size)
    if whole.shape != (2,) or whole.dtype.kind not in "iu":
        raise InputError(
            f"size: {size!r} is no (width, height) in whole pixels, such as (1920, 1080)"
        )
    return int(whole[0]), int(whole[1])


def _grey(photograph: AnyArray) -> AnyArray:
    """A photograph (H, W) in its own type: of colours the green, so that saturation stays visible."""
    known = np.asarray(photograph)
    if known.dtype.kind not in "uf" or known.ndim not in (2, 3) or known.shape[2:] not in CHANNELS:
        raise InputError(
            f"photograph: {known.dtype} of shape {known.shape}; give pixels (H, W) or (H, W, 3) as uint8, "
            "uint16 or float32"
        )
    return green(known[..., 0] if known.shape[2:] == (1,) else known)
