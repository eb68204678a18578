"""Corners of printed boards in photographs, by OpenCV 5."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.arrays import Array, Array32
from procam.errors import InputError

Picture = NDArray[np.uint8] | NDArray[np.uint16] | Array32
BoardKind = Literal["checkerboard", "charuco"]
CORNER_STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
MIN_WINDOW_PX, MAX_WINDOW_PX = 2, 11  # half width of the sub-pixel window
BRIGHT_PERCENT = 99.5  # that becomes white in 8 bits
SEARCH_PX, HINT_PX = 1600, 1000  # longest side of the copies that are searched
MIN_SQUARES = 4


@dataclass(frozen=True, slots=True)
class Board:
    """A printed board.

    Attributes
    ----------
    kind : "checkerboard", or "charuco" with ArUco markers in its white squares.
    squares : along both edges (columns, rows), the outermost ones included.
    square_m : edge of a square [m].
    marker_m, dictionary : edge of a marker [m] and OpenCV's name of their set, for charuco only.
    """

    kind: BoardKind
    squares: tuple[int, int]
    square_m: float
    marker_m: float = 0.0
    dictionary: str = "DICT_4X4_50"

    def __post_init__(self) -> None:
        if min(self.squares) < MIN_SQUARES or self.square_m <= 0:
            raise InputError(
                f"board: {self.squares[0]}x{self.squares[1]} squares of {self.square_m * 1e3:g} mm are no "
                f"board; it needs at least {MIN_SQUARES}x{MIN_SQUARES} squares of more than 0 mm. Count "
                "squares, not corners"
            )
        if self.kind == "charuco" and not 0 < self.marker_m < self.square_m:
            raise InputError(
                f"board: markers of {self.marker_m * 1e3:g} mm do not fit into squares of "
                f"{self.square_m * 1e3:g} mm; measure both with a ruler"
            )
        if not isinstance(getattr(cv2.aruco, self.dictionary, None), int):
            raise InputError(
                f"board: OpenCV has no marker dictionary {self.dictionary!r}; give the name printed with "
                "the board's data, such as DICT_4X4_50 or DICT_5X5_100"
            )

    @property
    def corners_m(self) -> Array:
        """Inner corners (N, 3), row by row [m]."""
        columns, rows = (n - 1 for n in self.squares)
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        grid = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
        return np.asarray(grid * self.square_m, np.float64)


def find_board(picture: Picture, board: Board) -> tuple[Array, Array] | None:
    """Corners of the board (N, 3) [m] and their pixels (N, 2) [px]; None if it is not found.

    A checkerboard must be visible as a whole; of a charuco board any part suffices.
    """
    grey = to_8bit(picture)
    if board.kind == "charuco":
        return _find_charuco(grey, board)
    pixels = _find_checkers(grey, board.squares)
    return None if pixels is None else (board.corners_m, pixels)


def suggest_squares(picture: Picture, squares: tuple[int, int]) -> tuple[int, int] | None:
    """The number of squares of the checkerboard in a picture, within two of `squares` per edge.

    The largest board found, since the sector method also finds a part of a board.
    """
    grey = to_8bit(picture)
    small, _ = _small_copy(grey, HINT_PX)
    steps = range(-2, 3)
    near = sorted(((squares[0] + i, squares[1] + j) for i in steps for j in steps), key=math.prod)
    for other in reversed(near):
        if other == squares or min(other) < MIN_SQUARES:
            continue
        if cv2.findChessboardCornersSB(small, (other[0] - 1, other[1] - 1))[0]:
            return other
    return None


def to_8bit(picture: Picture) -> NDArray[np.uint8]:
    """A picture (H, W) scaled to the 8 bits that the detectors need, its brightest parts near white."""
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture, np.uint8)
    bright = max(float(np.percentile(picture, BRIGHT_PERCENT)), 1e-30)
    return np.clip(np.rint(picture / bright * 250.0), 0, 255).astype(np.uint8)


def _find_checkers(grey: NDArray[np.uint8], squares: tuple[int, int]) -> Array | None:
    """Corners (N, 2) by the sector method, or by the older one, which tolerates more distortion.

    Both search a small copy: whole photographs of 12 megapixels take minutes. The gradients around each
    corner then locate it to 0.05 px, where the sector method itself scatters by 0.1 to 0.2 px.
    """
    inner = (squares[0] - 1, squares[1] - 1)
    small, share = _small_copy(grey, SEARCH_PX)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    found, corners = cv2.findChessboardCornersSB(small, inner, flags=flags)
    if not found:
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        flags |= cv2.CALIB_CB_FAST_CHECK
        found, corners = cv2.findChessboardCorners(small, inner, flags=flags)
    return _sharpen(grey, (_points(corners) + 0.5) / share - 0.5, inner) if found else None


def _small_copy(grey: NDArray[np.uint8], longest_px: int) -> tuple[NDArray[np.uint8], Array]:
    """The picture with no side longer than this, and the scales (2,) of x and y."""
    height, width = grey.shape
    share = min(1.0, longest_px / max(width, height))
    size = (max(round(width * share), 1), max(round(height * share), 1))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), np.array(size) / (width, height)


def _sharpen(grey: NDArray[np.uint8], corners: Array, inner: tuple[int, int]) -> Array:
    """Sub-pixel corners (N, 2), each from a window without a second corner."""
    grid = corners.reshape(inner[1], inner[0], 2)
    steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    half = int(np.clip(min(steps) / 2.5, MIN_WINDOW_PX, MAX_WINDOW_PX))
    start = corners.astype(np.float32).reshape(-1, 1, 2)
    return _points(cv2.cornerSubPix(grey, start, (half, half), (-1, -1), CORNER_STOP))


def _find_charuco(grey: NDArray[np.uint8], board: Board) -> tuple[Array, Array] | None:
    """Corners of a charuco board in whichever of OpenCV's two layouts shows more of them."""
    name = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    best: tuple[Any, Any] | None = None
    for old in (False, True):
        layout = cv2.aruco.CharucoBoard(board.squares, board.square_m, board.marker_m, name)
        layout.setLegacyPattern(old)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(layout).detectBoard(grey)
        if corners is not None and (best is None or len(corners) > len(best[0])):
            best = corners, ids
    if best is None:
        return None
    return board.corners_m[np.asarray(best[1]).ravel()], _points(best[0])


def _points(corners: Any) -> Array:
    """OpenCV's (N, 2) or (N, 1, 2) of either precision as (N, 2)."""
    return np.asarray(corners, np.float64).reshape(-1, 2)
