"""The board in photographs, and what `procam lens board` and `procam lens pair` say of a fit."""

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
from scipy.stats import binom

from procam.arrays import Array
from procam.errors import InputError
from procam.estimate.boards.robust_fit import DroppedCorner
from procam.estimate.boards.targets import Board, BoardKind
from procam.files.venue.edit import Key
from procam.interfaces.cli._paths import two_counts
from procam.maths.geometry.lenses import Lens
from procam.model.quality import Figure, Goal

WORST_RMS = Goal("<=", 1.0)  # [px]; a sound fit is at a few tenths
SMALLEST_MM, LARGEST_MM = 0.01, 10_000.0  # edge of a square
# a curled board: this share of the dropped corners lies within this share of the board's extent from one
# edge, where a quarter of the corners is, and by chance it would in one set of a hundred
EDGE_SHARE, EDGE, EDGE_CORNERS, BY_CHANCE = 0.7, 0.2, 0.25, 0.01
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


def lens_keys(lens: Lens, size: tuple[int, int], sigma: Sequence[float]) -> list[Key]:
    """The keys of a lens in venue.toml, with standard errors as far as they are given."""
    known = len(sigma) > len("fxcy")
    return [
        Key("model", lens.kind),
        Key("size", size),
        Key("f", lens.focal.round(4).tolist(), f"{sigmas(sigma[:2])} px"),
        Key("c", lens.centre.round(4).tolist(), f"{sigmas(sigma[2:4])} px; {PIXEL_ORIGIN}"),
        Key(
            "k",
            lens.distortion.round(8).tolist(),
            sigmas(sigma[4:]) if known else "0, not solved for",
        ),
    ]


def sigmas(values: Sequence[float]) -> str:
    """Standard errors for a comment."""
    return ", ".join(f"{v:.2g}" for v in values)


def as_rows(dropped: Sequence[DroppedCorner]) -> list[dict[str, Any]]:
    """Dropped corners as JSON has them."""
    return [
        {"view": d.view, "corner": d.index, "pixel": list(d.pixel), "miss_px": d.miss_px}
        for d in dropped
    ]


def bend_figure(bend: Array, views: int) -> Figure:
    """How far the board's rim lies off its plane, from the coefficients (3,) of `BoardRig.bend` [m]."""
    u2, v2, uv = bend
    sag = np.abs(np.linalg.eigvalsh([[u2, uv / 2], [uv / 2, v2]])).max()
    return Figure(float(sag) * 1e3, "mm", None, views, "at the board's rim")


def edge_note(dropped: Sequence[DroppedCorner], area: Array) -> str | None:
    """What it means that most dropped corners lie at one edge of the board's area (2, 2) [m]."""
    if not dropped:
        return None
    share = (np.array([d.place_m for d in dropped]) - area[0]) / (area[1] - area[0])
    most = int(np.concatenate([share <= EDGE, share >= 1 - EDGE], axis=1).sum(axis=0).max())
    chance = 4 * binom.sf(most - 1, len(dropped), EDGE_CORNERS)
    if most < EDGE_SHARE * len(dropped) or chance > BY_CHANCE:
        return None
    return (
        f"{'all' if most == len(dropped) else most} of {len(dropped)} dropped corners are from one edge: the "
        "board is curled; glue it to a flat plate and photograph it again"
    )
