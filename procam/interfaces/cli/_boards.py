"""The board in photographs, and what `procam camera` and `procam pair` write about a fit."""

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from procam.errors import InputError
from procam.estimate.boards.targets import Board, BoardKind
from procam.interfaces.cli._paths import two_counts
from procam.maths.geometry.lenses import Lens
from procam.model.quality import Goal

WORST_RMS = Goal("<=", 1.0)  # [px]; a sound fit is at a few tenths
SMALLEST_MM, LARGEST_MM = 0.01, 10_000.0  # edge of a square
PIXEL_ORIGIN = "(0, 0) is the centre of the first pixel"


def make_board(
    squares: str,
    square_mm: float,
    kind: str = "checkerboard",
    marker_mm: float = 0.0,
    dictionary: str = "DICT_4X4_50",
) -> Board:
    """The board that the options of a command describe."""
    count = two_counts("--squares", squares, "COLUMNSxROWS, such as 10x7, all squares counted")
    kinds = get_args(BoardKind)
    if kind not in kinds:
        raise InputError(f"--board {kind!r} is unknown; choose {' or '.join(kinds)}")
    if not SMALLEST_MM <= square_mm <= LARGEST_MM:  # also refuses NaN
        raise InputError(
            f"--square-mm is {square_mm:g}; it must lie between {SMALLEST_MM:g} and {LARGEST_MM:g} mm. "
            "Measure several squares with a ruler and divide"
        )
    return Board(kind, count, square_mm / 1e3, marker_mm / 1e3, dictionary)  # type: ignore[arg-type]


def count_text(pair: tuple[int, int]) -> str:
    """A count of squares as the option has it."""
    return f"{pair[0]}x{pair[1]}"


def coefficients(lens: Lens) -> list[float]:
    """Focal lengths, centre and distortion in one list."""
    values: list[float] = np.concatenate([lens.focal, lens.centre, lens.distortion]).tolist()
    return values


def lens_rows(lens: Lens, size: tuple[int, int], sigma: Sequence[float]) -> list[str]:
    """The keys of a lens in venue.toml; standard errors as comments, as far as they are given."""
    no_distortion = "  # not solved for" if len(sigma) <= len("fxcy") else ""
    return [
        f'model = "{lens.kind}"',
        f"size = [{size[0]}, {size[1]}]",
        f"f = {listed(lens.focal, 4)}  # +- {sigmas(sigma[:2])} px",
        f"c = {listed(lens.centre, 4)}  # +- {sigmas(sigma[2:4])} px; {PIXEL_ORIGIN}",
        f"k = {listed(lens.distortion, 8)}" + (no_distortion or f"  # +- {sigmas(sigma[4:])}"),
    ]


def listed(values: Any, digits: int) -> str:
    """Values as a TOML array."""
    return f"[{', '.join(f'{v:.{digits}f}' for v in values)}]"


def sigmas(values: Sequence[float]) -> str:
    """Standard errors for a comment."""
    return ", ".join(f"{v:.2g}" for v in values)
