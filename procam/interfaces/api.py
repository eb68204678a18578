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
from procam.estimate.structured_light import codes
from procam.estimate.structured_light.decode import Decoder
from procam.files.calibration import load_calibration
from procam.files.session import Session
from procam.files.venue.load import load_venue
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._sessions import take, venue_of
from procam.maths.geometry.lenses import LensKind
from procam.model.calibration import Calibration
from procam.model.correspondence import CorrespondenceMap
from procam.workflows.solve import calibrate


def generate_patterns(
    size: tuple[int, int], code: str = codes.DEFAULT_CODE
) -> list[NDArray[np.uint8]]:
    """Patterns of a structured-light code, to be shown full screen in this order.

    Parameters
    ----------
    size : (width, height) of the projector [px].
    code : name of the code, as for `procam patterns --code`.

    Returns
    -------
    patterns : (height, width) each, encoded for a display gamma of 2.2; white and black come first.

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
    return [picture[..., 0] for picture in codes.generate(codes.make_code(code, size))]


def decode(
    photographs: Iterable[AnyArray], size: tuple[int, int], code: str = codes.DEFAULT_CODE
) -> CorrespondenceMap:
    """Projector coordinates of every camera pixel, from photographs of `generate_patterns`.

    Parameters
    ----------
    photographs : (H, W) or (H, W, C) each, uint8, uint16 or float32, linear, in the order of the
        patterns. They are folded in one by one, so a generator keeps memory flat.
    size : (width, height) of the projector [px].
    code : as for `generate_patterns`.

    Returns
    -------
    correspondence : projector_xy (H, W, 2) and sigma_px (H, W, 2) [px], NaN where `valid` is false.

    Raises
    ------
    InputError, NotEnoughData
        Photographs of different sizes; too few of them.

    Examples
    --------
    >>> found = decode(generate_patterns((128, 80)), (128, 80))
    >>> bool(found.valid.mean() > 0.9)
    True
    """
    decoder = Decoder(codes.make_code(code, size))
    planes = len(decoder.code.planes)
    for number, photograph in enumerate(photographs):
        if number >= planes:
            raise InputError(
                f"decode: the code {code} has {planes} patterns, and there are more photographs."
            )
        decoder.add(number, _grey(photograph))
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
    sizes = {photograph.shape[1::-1] for photograph in photographs}
    if len(sizes) != 1:
        raise InputError(
            f"calibrate_camera: the photographs have {len(sizes)} sizes; give one or more of one size."
        )
    found = ((i, find_board(_grey(p), board)) for i, p in enumerate(photographs))
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
    return take(load_venue(Path(venue)), Output(as_json=True)).directory


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
    *_, last = calibrate.solve(load_venue(venue_of(directory)), Session(directory))
    return load_calibration(Path(last.data["calibration"]))


def _grey(photograph: AnyArray) -> AnyArray:
    """A photograph (H, W), in its own type if it is grey."""
    if photograph.ndim == 2:
        return photograph
    return np.asarray(photograph[..., :3].mean(axis=-1), np.float32)
