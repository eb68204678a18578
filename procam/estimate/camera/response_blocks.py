"""Bracketed photographs as means over small squares, and the choice of those that a fit of the response uses.

A place where something moved is one whose level does not follow from its level in the next shorter exposure
as that of most places does. No curve enters this comparison.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from procam.arrays import AnyArray, Array, BoolArray, IndexArray
from procam.errors import InputError, NotEnoughData, OutOfModelRange, ShapeError
from procam.estimate.camera.response_fit import Blocks
from procam.maths.statistics import robust_sigma

MAX_GAMMA = 6.0  # between neighbouring exposures; no development is steeper
BLOCKS = 60_000  # squares that a photograph is averaged to, about
BLOCK_PX = (2, 16)  # smallest and largest edge of a square
BINS, PER_BIN = 64, 60  # of brightness; the flattest squares of each are used
MIN_PIXELS = 50
MOVED_SIGMAS, MOVED_LEVEL = 6.0, 0.03  # of a level that does not follow; share of the range
MIN_GROUP = 200  # places whose levels are compared
BRIGHTEST = 0.995  # quantile of a photograph's squares
WHITE = 0.985  # share of the range that they must reach in one of the photographs


@dataclass(frozen=True, slots=True)
class BracketBlocks:
    """All squares of J photographs: `blocks` in N = rows * columns * channels, in the order of `grid`."""

    blocks: Blocks
    grid: tuple[int, int, int]

    def of(self, photographs: IndexArray, channel: int | None = None) -> Blocks:
        """The squares in some of the photographs, in one channel or all."""
        some = self.blocks.photographs(photographs)
        if channel is None:
            return some
        return some.take(np.arange(channel, some.level.shape[1], self.grid[2]))

    def moved(self, photographs: IndexArray, seconds: Array) -> BoolArray:
        """Squares (J, N) in which something moved, found in each channel by itself."""
        marks = [find_moved(self.of(photographs, c), seconds) for c in range(self.grid[2])]
        return np.stack(marks, axis=-1).reshape(len(photographs), -1)

    def places(self, marked: BoolArray) -> BoolArray:
        """Places (rows, columns) with a mark (J, N) in any photograph and channel."""
        return np.asarray(np.any(np.any(marked, axis=0).reshape(self.grid), axis=2))


def average(photos: Iterable[AnyArray], count: int, top: float) -> BracketBlocks:
    """Means over small squares of `count` photographs (H, W) or (H, W, C) with levels up to `top`.

    Raises
    ------
    ShapeError
        Photographs of several shapes.
    InputError
        Another number of photographs.
    """
    parts, shape, edge = list[tuple[Array, Array, BoolArray]](), None, 1
    for number, photo in enumerate(photos, start=1):
        if shape is None:
            shape = photo.shape
            edge = int(np.clip(np.sqrt(np.prod(shape[:2]) / BLOCKS), *BLOCK_PX))
        if photo.ndim not in (2, 3):
            raise ShapeError(f"photograph {number}", photo.shape, "(H, W) or (H, W, C)")
        if photo.shape != shape:
            raise ShapeError(f"photograph {number}", photo.shape, f"{shape} like the first")
        parts.append(_squares(photo.reshape(*photo.shape[:2], -1), top, edge))
    if len(parts) != count or shape is None:
        raise InputError(
            f"brackets: {len(parts)} photographs and {count} exposures do not match; give one exposure "
            "for each photograph"
        )
    level, deviation, sound = (np.stack(part) for part in zip(*parts, strict=True))
    grid = (shape[0] // edge, shape[1] // edge, shape[2] if len(shape) == 3 else 1)
    return BracketBlocks(Blocks(edge, level, deviation, sound), grid)


def check_white(blocks: Blocks) -> None:
    """Refuse photographs none of which reaches white, the level that light is relative to.

    Raises
    ------
    NotEnoughData
        The longest exposure is too short, or the camera clips below the full range.
    """
    brightest = float(np.quantile(blocks.level, BRIGHTEST, axis=1).max())
    if brightest < WHITE:
        raise NotEnoughData(
            f"brackets: the brightest of the photographs reaches {brightest:.0%} of the range; white is "
            "needed. Take a longer exposure. If that does not reach it, set the camera to full instead of "
            "limited (video) range, and to a picture profile that reaches white"
        )


def check_rise(blocks: Blocks, seconds: Array) -> None:
    """Refuse longer exposures that are not brighter.

    Raises
    ------
    NotEnoughData
        Two neighbouring exposures share too few unclipped places.
    OutOfModelRange
        The longer of two exposures is not brighter.
    """
    order = np.argsort(seconds)
    for first, second in pairwise(order):
        both = blocks.sound[first] & blocks.sound[second]
        pair = f"photographs {first + 1} and {second + 1} ({seconds[first]:g} and {seconds[second]:g} s)"
        if both.sum() < MIN_PIXELS:
            raise NotEnoughData(
                f"brackets: {pair}: only {int(both.sum())} places are neither black nor white in both; "
                f"{MIN_PIXELS} are needed. Leave out what is all black or white, or take an exposure "
                "between them, of a scene with all shades"
            )
        dim, bright = blocks.level[first][both], blocks.level[second][both]
        lit = dim >= np.percentile(dim, 90)  # darker places may be all noise
        rise = float(np.median(bright[lit] / dim[lit]))
        least = (seconds[second] / seconds[first]) ** (1 / MAX_GAMMA)
        if rise < least:
            raise OutOfModelRange(
                f"brackets: {pair}: the levels change by a factor of {rise:.3f}; {least:.3f} is the least "
                "for these exposures. Check that the photographs are not exchanged, and that neither "
                "exposure nor ISO was automatic"
            )


def find_moved(blocks: Blocks, seconds: Array) -> BoolArray:
    """Squares (J, N) whose level does not follow from that in the next shorter exposure, in both of them."""
    moved = np.zeros(blocks.level.shape, bool)
    for first, second in pairwise(np.argsort(seconds)):
        both = np.flatnonzero(blocks.sound[first] & blocks.sound[second])
        ordered = both[np.argsort(blocks.level[first, both], kind="stable")]
        for group in np.array_split(ordered, max(1, min(BINS, both.size // MIN_GROUP))):
            odd = group[_odd(blocks.level[first, group], blocks.level[second, group])]
            moved[first, odd] = moved[second, odd] = True
    return moved


def choose(blocks: Blocks, moved: BoolArray) -> Blocks:
    """Flat squares of all brightnesses, each unclipped in two exposures or more, where nothing moved."""
    bright = blocks.level.mean(axis=0)
    rough = np.where(blocks.sound, blocks.deviation, 0).max(axis=0)
    usable = (blocks.sound.sum(axis=0) >= 2) & ~moved.any(axis=0)
    bins = np.minimum(BINS * bright, BINS - 1).astype(int)
    chosen = []
    for each in range(BINS):
        inside = np.flatnonzero(usable & (bins == each))
        chosen.append(inside[np.argsort(rough[inside], kind="stable")[:PER_BIN]])
    return blocks.take(np.concatenate(chosen))


def _squares(photo: AnyArray, top: float, edge: int) -> tuple[Array, Array, BoolArray]:
    height, width, channels = photo.shape
    rows, columns = height // edge, width // edge
    cut = photo[: rows * edge, : columns * edge].reshape(rows, edge, columns, edge, channels)
    mean = cut.mean(axis=(1, 3), dtype=float)
    square = np.square(cut, dtype=np.float32).sum(axis=(1, 3), dtype=float)
    variance = np.maximum(square / edge**2 - mean**2, 0)
    sound = (cut.min(axis=(1, 3)) > 0) & (cut.max(axis=(1, 3)) < top)
    return mean.ravel() / top, np.sqrt(variance).ravel() / top, sound.ravel()


def _odd(level: Array, longer: Array) -> BoolArray:
    """Levels of a longer exposure off the line through those of the other places of similar level."""
    lower, upper = np.array_split(np.arange(level.size), 2)
    run = (
        float(np.median(level[upper]) - np.median(level[lower]))
        if lower.size and upper.size
        else 0.0
    )
    slope = float(np.median(longer[upper]) - np.median(longer[lower])) / run if run > 0 else 0.0
    off = longer - slope * level
    off -= np.median(off)
    return np.asarray(np.abs(off) > max(MOVED_SIGMAS * robust_sigma(off), MOVED_LEVEL))
