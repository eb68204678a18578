"""The closed loop's arithmetic: from a photograph of a picture to a better picture (science.md s.6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.maths.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.warp import sample
from procam.model.calibration import Calibration

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
LOOP_SIZE = 256
FREE_SHARE = 0.98
JACOBI_STEPS = 6


@dataclass(frozen=True, slots=True)
class Cells:
    """Camera pixels gathered into the cells of a small dome master.

    `index` (K,) is the cell of each camera pixel of `use` (H, W); `count` (N, N) pixels per
    cell, `direction` (H, W, 3) what each camera pixel sees.
    """

    use: Mask
    index: NDArray[np.intp]
    count: Array
    direction: Image

    @classmethod
    def of(cls, direction: Image, on_screen: Mask) -> "Cells":
        """Cells for a camera that sees `direction` (H, W, 3) where `on_screen`."""
        seen = direction[on_screen]
        place = np.rint(master_pixels(seen, LOOP_SIZE)).astype(np.intp)
        inside = np.all((place >= 0) & (place < LOOP_SIZE), axis=-1)
        use = on_screen.copy()
        use[on_screen] = inside
        index = place[inside, 1] * LOOP_SIZE + place[inside, 0]
        count = np.bincount(index, minlength=LOOP_SIZE**2).astype(float)
        return cls(use, index, count.reshape(LOOP_SIZE, LOOP_SIZE), np.nan_to_num(direction))

    def average(self, light: Image) -> Array:
        """Cell means (N, N, C) of a camera picture (H, W, C)."""
        return self._means(light[self.use])

    def average_master(self, master: Image) -> Array:
        """Cell means of a dome master, read where the camera's pixels look: same sampling."""
        where = master_pixels(self.direction, master.shape[0])
        return self._means(sample(master, where)[self.use])

    def _means(self, values: Image) -> Array:
        sums = [np.bincount(self.index, values[:, c], LOOP_SIZE**2) for c in range(3)]
        shape = (LOOP_SIZE, LOOP_SIZE, 3)
        return np.stack(sums, axis=-1).reshape(shape) / np.maximum(self.count, 1)[..., None]


class Loop:
    """Preconditioned closed loop over cells that no limit holds.

    dx = r - u (a.r) / (1 + m) over the free cells undoes the bounces that the correction itself
    will cause. The gain is each step's share of all photographs so far: the first step takes the
    whole error out, the rest average the camera's noise away.
    A cell is far wider than any registration error, so no further low-pass is needed.
    """

    def __init__(self, calibration: Calibration, cells: Cells, free: Mask) -> None:
        maps = calibration.maps
        direction, inside = master_directions(LOOP_SIZE)
        where = master_pixels(direction, maps.size)
        self._maps = maps
        self._scatter = sample(maps.scatter_per_flux, where).astype(float)
        self._solid = master_solid_angles(LOOP_SIZE)
        covered = cells.average_master(np.repeat(maps.coverage[..., None], 3, axis=-1))
        cell_free = cells.average_master(free.astype(np.float32)) > FREE_SHARE
        self.free = (inside & (cells.count > 0))[..., None] & (covered > FREE_SHARE) & cell_free
        self.correction = np.zeros((LOOP_SIZE, LOOP_SIZE, 3))
        self.steps = self.photographs = 0

    def residual_rms(self, residual: Array) -> float:
        """Root mean square (over free cells and channels) [rel to white]."""
        return float(np.sqrt(np.mean(residual[self.free] ** 2)))

    def update(self, residual: Array, photographs: int) -> None:
        """Fold target minus seen (N, N, 3), a mean of `photographs`, into the correction."""
        self.steps += 1
        self.photographs += photographs
        gain = photographs / self.photographs
        step = np.zeros_like(residual)
        for c in range(3):
            free = self.free[..., c]
            r = np.where(free, residual[..., c], 0)
            weight = np.where(free, self._solid, 0)
            u = self._scatter[..., c]
            common = float((weight * r).sum()) / (1 + float((weight * u).sum()))
            step[..., c] = np.where(free, r - u * common, 0)
        self.correction += gain * step

    def corrected(self, direct: Image) -> Image:
        """Direct light (N, N, 3) of a picture with the correction added where it applies.

        Between free cells and others it fades; of that nothing reaches what a person protects.
        """
        size = direct.shape[0]
        direction, _ = master_directions(size)
        nodes = _nodes_for_means(self.correction)
        added = sample(nodes, master_pixels(direction, LOOP_SIZE))
        protected = self._maps.is_protected(master_pixels(direction, self._maps.size))[..., None]
        corrected = np.where(direct > 0, np.maximum(direct + added, 0), 0)
        return np.where(protected, direct, corrected).astype(np.float32)

    def gain_factor(self, direct: Image, cells: Cells) -> Array:
        """(N, N, 3) by which the calibration's gain was wrong: light got per light asked."""
        asked = cells.average_master(direct)
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = asked / (asked + self.correction)
        trusted = self.free & (asked > 0.05) & np.isfinite(factor)
        return np.where(trusted, np.clip(factor, 0.8, 1.25), 1.0)


def _nodes_for_means(means: Array) -> Array:
    """Node values (N, N, C) whose bilinear interpolation has the given cell means.

    The mean over a cell weighs its node and the neighbours 1/8, 3/4, 1/8 along each axis; Jacobi
    steps undo that. Without it the loop would answer fine structure with half of what it needs.
    """
    nodes = means.copy()
    for _ in range(JACOBI_STEPS):
        blurred = nodes
        for axis in (0, 1):
            ends = np.roll(blurred, 1, axis) + np.roll(blurred, -1, axis)
            blurred = 0.75 * blurred + 0.125 * ends
        nodes = nodes + means - blurred
    return nodes
