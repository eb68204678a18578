"""Columns from the phase of sinusoids within cells that Gray patterns count.

The phase of the shortest period gives a column up to whole periods. Each candidate predicts what all
other patterns show there, and the one with the least sum of squares is kept
(docs/theory/structured-light.md (S6)). At an edge between cells one stripe pattern is grey, and its
grey level decides as well as its bits do elsewhere, so no pixel is off by a period there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from procam import kernels
from procam.arrays import AnyArray, Array, Array32, IndexArray
from procam.estimate.structured_light.codes import AxisCode, Plane
from procam.maths.codes.phase import WaveDistortion, Waves

PHASES = 64  # parts of a period in which candidates are predicted once
EDGE_PX = 1.0  # blur of a stripe's edge that is expected, standard deviation
MISREAD = 0.75  # squared amplitudes that the stripes of a pixel may differ from the prediction
MARGIN_PX = 1.5  # beyond the panel where a column may still be looked for
BLOCK = 1 << 20  # pixels at a time, to save memory
PARTS = ("position", "variance", "amplitude", "offset", "residual", "margin")


@dataclass(frozen=True, slots=True)
class Cells:
    """What the stripes of one axis show, beneath its sinusoids.

    Attributes
    ----------
    lines : (B, length) the stripe patterns along the axis, -1 to 1, with blurred edges.
    contrast : B arrays (H, W) or (n,), pattern less inverse [any unit].
    middle : (H, W) or (n,) the mean of white and black [image unit].
    """

    lines: Array
    contrast: tuple[Array32, ...]
    middle: Array32

    def at(self, where: IndexArray | slice) -> "Cells":
        """The samples of some rows, or of the pixels `where` (n,), counted along the rows."""
        flat = not isinstance(where, slice)
        parts = [(np.ravel(one) if flat else one)[where] for one in (*self.contrast, self.middle)]
        return Cells(self.lines, tuple(parts[:-1]), parts[-1])


class CellImages:
    """Collects the stripe photographs of one axis; white and black replace a missing inverse."""

    def __init__(self, coding: AxisCode, white: AnyArray, black: AnyArray) -> None:
        self._coding = coding
        self._middle = np.asarray(np.add(white, black, dtype=np.float32) / 2, np.float32)
        self._seen: dict[int, dict[bool, AnyArray]] = {}

    def add(self, plane: Plane, image: AnyArray) -> None:
        """Add the photograph (H, W) of a stripe pattern."""
        self._seen.setdefault(plane.bit, {})[plane.inverse] = image

    def result(self) -> Cells:
        """The contrasts of the patterns so far."""
        bits = sorted(self._seen, reverse=True)
        lines = stripe_lines(self._coding)[[self._coding.bits - 1 - bit for bit in bits]]
        return Cells(lines, tuple(self._contrast(bit) for bit in bits), self._middle)

    def _contrast(self, bit: int) -> Array32:
        shown = {inverse: image.astype(np.float32) for inverse, image in self._seen[bit].items()}
        if len(shown) == 2:
            return shown[False] - shown[True]
        ((inverse, image),) = shown.items()
        twice = np.float32(-2 if inverse else 2)
        return np.asarray(twice * (image - self._middle), np.float32)


def stripe_lines(coding: AxisCode) -> Array:
    """The stripe patterns (B, length) of an axis from coarse to fine, -1 to 1, with blurred edges."""
    if coding.codewords is None:
        return np.zeros((0, coding.length))
    bits = np.arange(coding.bits)[::-1]
    sharp = 2.0 * ((coding.codewords >> bits[:, None]) & 1) - 1
    return np.asarray(gaussian_filter1d(sharp, EDGE_PX, axis=1, mode="nearest"))


def predicted(columns: Array, waves: Waves, distortion: WaveDistortion, lines: Array) -> Array:
    """What the patterns after the base show at columns (n,): (n, K - base + B), in amplitudes."""
    later = np.arange(len(waves.periods)) >= waves.base
    wave = (distortion.modulation(waves) * np.cos(waves.angles(columns)))[:, later]
    grid = np.arange(lines.shape[1])
    return np.column_stack([wave, *(np.interp(columns, grid, line) for line in lines)])


def find_in_cells(
    frames: Sequence[AnyArray],
    waves: Waves,
    distortion: WaveDistortion,
    length: int,
    cells: Cells,
) -> kernels.PhaseFit:
    """Best column of every pixel, from the phase of the base and all other patterns.

    NaN where the stripes contradict every candidate.
    """
    found = [
        np.empty(np.shape(frames[0]), np.float32) for _ in PARTS
    ]  # one can go without the others
    step = max(1, BLOCK // int(np.prod(np.shape(frames[0])[1:], dtype=int)))
    for start in range(0, len(found[0]), step):
        rows = slice(start, start + step)
        flat = [np.ravel(frame[rows]) for frame in frames]
        part = _find(flat, waves, distortion, length, cells.at(rows))
        for values, new in zip(found, part, strict=True):
            values[rows] = new.reshape(values[rows].shape)
    return kernels.PhaseFit(*found)


def _find(
    flat: Sequence[AnyArray],
    waves: Waves,
    distortion: WaveDistortion,
    length: int,
    cells: Cells,
) -> Array32:
    """The parts of the fit (parts, n) of pixels (n,)."""
    found = np.full((len(PARTS), flat[0].size), np.nan, np.float32)
    base = _fit(flat[: waves.base], waves.kept(np.arange(len(flat)) < waves.base), distortion)
    turn, margin, good = _turns(flat, base, waves, distortion, length, cells)
    order = np.argsort(turn, kind="stable")
    groups, starts = np.unique(turn[order], return_index=True)
    for group, some in zip(groups, np.split(order, starts[1:]), strict=True):
        start = float(group) * waves.periods[0]
        moved = Waves(waves.periods, waves.shifts - 2 * np.pi * start / waves.periods, waves.base)
        part = np.stack(_fit([frame[some] for frame in flat], moved, distortion))
        part[0] += start
        found[:, some] = part
    found[0, ~good] = np.nan
    found[-1] = margin
    return found


def _fit(frames: Sequence[AnyArray], waves: Waves, distortion: WaveDistortion) -> kernels.PhaseFit:
    """Fit within the first period."""
    terms = (distortion.modulation(waves), distortion.harmonics(waves))
    return kernels.search_phase(frames, waves.periods, waves.shifts, *terms, waves.base, 1)


def _turns(
    frames: Sequence[AnyArray],
    base: kernels.PhaseFit,
    waves: Waves,
    distortion: WaveDistortion,
    length: int,
    cells: Cells,
) -> tuple[IndexArray, Array32, AnyArray]:
    """Whole periods (n,) before each pixel's column, margin [sum of squares], and whether it is clear."""
    period, lines = float(waves.periods[0]), cells.lines
    values = _values(frames, base, waves, cells)
    turns = np.arange(int(np.ceil((length + MARGIN_PX) / period)) + 1)
    turn = np.zeros(len(values), int)
    margin, misread = np.zeros((2, len(values)), np.float32)
    phase = np.nan_to_num(base.position / period + 0.25)
    part_of = np.clip((phase * PHASES).astype(int), 0, PHASES - 1)
    for part in range(PHASES):
        some = np.flatnonzero(part_of == part)
        columns = np.asarray(((part + 0.5) / PHASES - 0.25 + turns) * period, float)
        on_panel = (columns >= -MARGIN_PX) & (columns <= length - 1 + MARGIN_PX)
        if not some.size or not on_panel.any():
            continue
        curve = predicted(columns[on_panel], waves, distortion, lines).astype(np.float32)
        turn[some], margin[some], misread[some] = _best(
            values[some], curve, turns[on_panel], len(lines)
        )
    good = (misread <= MISREAD) & np.isfinite(base.position)
    return turn, margin * np.nan_to_num(base.amplitude) ** 2, good


def _values(
    frames: Sequence[AnyArray], base: kernels.PhaseFit, waves: Waves, cells: Cells
) -> Array32:
    """Samples (n, K - base + B) of the patterns after the base, in amplitudes."""
    amplitude = np.maximum(np.nan_to_num(base.amplitude), 1e-9)
    later = [(frame - base.offset) / amplitude for frame in frames[waves.base :]]
    if cells.contrast:
        contrast = [np.ravel(one) for one in cells.contrast]
        most = np.maximum(np.max(np.abs(contrast), axis=0), 1e-9)
        later += [one / most for one in contrast]
    return np.nan_to_num(np.stack(later, axis=1).astype(np.float32))


def _best(
    values: Array32, curve: Array32, turns: IndexArray, stripes: int
) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Best turn (n,), its margin and the squares that the stripes leave, in squared amplitudes."""
    squares = np.sum(values**2, axis=1)[:, None] + np.sum(curve**2, axis=1) - 2 * values @ curve.T
    best = squares.argmin(axis=1)
    every = np.arange(len(values))
    least = squares[every, best]
    squares[every, best] = np.inf
    waves = values.shape[1] - stripes
    misread = np.sum((values[:, waves:] - curve[best, waves:]) ** 2, axis=1)
    return turns[best], squares.min(axis=1) - least, misread
