"""The closed loop on a dome master: from photographs of a picture to a better picture and calibration.

Photographs and pictures are averaged over cells of a small dome master (`LoopCells`), on which
`LoopState` estimates what the calibration did not predict (docs/theory/closed-loop.md). `DomeLoop` keeps the
correction per cell, interpolates it to the picture between the limits of the projectors, and repeats.
`refined.refined_calibration` turns the estimates into a new calibration.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from procam.arrays import Array, BoolArray, Image, IndexArray
from procam.errors import NotEnoughData
from procam.estimate.closed_loop.gains import gain_change
from procam.estimate.closed_loop.patches import (
    CELL_QUANTILE,
    LoopObservation,
    LoopState,
    PatchScatter,
)
from procam.maths.geometry.sphere import master_directions, master_pixels, master_solid_angles
from procam.maths.light.scatter_kernel import basis
from procam.maths.warp import block_mean, blur_within, sample
from procam.model.calibration import Calibration

LOOP_SIZE = 256
CELL_ARCMIN = 180 * 60 / LOOP_SIZE
BLOCK = 32  # cells, 22 degrees: errors of gains further apart are taken as independent
FREE_SHARE = 0.98  # of a cell that must satisfy a condition
MAX_GAIN_CHANGE = 0.25  # factor up to 1 + this, down to its inverse
TINY = 1e-5  # of white, between a value and a limit that it has reached
NEAR, STRAY = 7, 0.05  # cells that lens stray light reaches, and its share of their contrast
LEVELS = 16  # groups of equal level, for the noise
JACOBI_STEPS = 6


@dataclass(frozen=True, slots=True)
class LoopCells:
    """Assignment of camera pixels to the cells of a small dome master.

    `index` (K,) is the cell of each camera pixel of `use` (H, W); `count` (N, N) is the number of
    pixels per cell, `direction` (H, W, 3) that of each camera pixel.
    """

    use: BoolArray
    index: IndexArray
    count: Array
    direction: Image

    @classmethod
    def of(cls, direction: Image, on_screen: BoolArray) -> "LoopCells":
        """Cells for a camera with pixel directions (H, W, 3) where `on_screen` (H, W)."""
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
        """Cell means (N, N, C) of a dome master, sampled in the directions of the camera's pixels."""
        where = master_pixels(self.direction, master.shape[0])
        return self._means(sample(master, where)[self.use])

    def _means(self, values: Image) -> Array:
        sums = [np.bincount(self.index, values[:, c], LOOP_SIZE**2) for c in range(3)]
        shape = (LOOP_SIZE, LOOP_SIZE, 3)
        return np.stack(sums, axis=-1).reshape(shape) / np.maximum(self.count, 1)[..., None]


class DomeLoop:
    """The closed loop on one picture, over cells of a dome master.

    The correction is bilinear between cells, clipped to the limits of each pixel, and low-passed at
    twice the registration error where that exceeds a cell's width.

    Parameters
    ----------
    calibration, cells : the dome, and the camera's cells.
    direct : (N, N, 3) direct light of the compensated picture [rel].
    target : (N, N, 3) total light that the audience should see [rel].
    find_scatter : estimate the factor of scattered light too, which needs dark cells.

    Attributes
    ----------
    picture : (N, N, 3) direct light of the corrected picture [rel].
    goal, correction : (M, M, 3) cell means of `target`; the correction of direct light [rel].
    known, free : (M, M, 3) cells that the camera sees; those that no limit holds.
    state : the estimates. block : (M, M) neighbourhoods of cells.

    Raises
    ------
    NotEnoughData
        If a limit holds in every cell.
    """

    def __init__(
        self,
        calibration: Calibration,
        cells: LoopCells,
        direct: Image,
        target: Image,
        find_scatter: bool = True,
    ) -> None:
        maps, size = calibration.maps, direct.shape[0]
        self._cells, self._start = cells, direct
        where = master_pixels(master_directions(size)[0], maps.size)
        coverage = sample(maps.coverage, where)
        self._coverage = coverage[..., None]
        self._lo = sample(maps.lo, where)
        # hi is multiplied by coverage, but a pixel on the border can be driven fully where it is lit
        self._hi = np.maximum(sample(maps.hi, where) / np.maximum(self._coverage, 0.5), self._lo)
        self._protected = (maps.is_protected(where) & (coverage > 0))[..., None]
        self.direction, self._inside = master_directions(LOOP_SIZE)
        ours = (coverage * ~self._protected[..., 0])[..., None].repeat(3, axis=-1)
        known = (cells.average_master(ours) > FREE_SHARE) & (cells.count > 0)[..., None]
        self.known = known & self._inside[..., None]
        self.goal = cells.average_master(target)
        self.correction = np.zeros((LOOP_SIZE, LOOP_SIZE, 3))
        block = np.arange(LOOP_SIZE) // BLOCK
        self.block = block[:, None] * (LOOP_SIZE // BLOCK) + block
        self._low_pass_cells = low_pass_cells(calibration)
        m = calibration.feedback
        self.state = LoopState(
            self._scatter(calibration),
            self.block[self._inside],
            m.sigma / np.maximum(m.value, TINY) if find_scatter else np.full(3, np.inf),
            self._low_pass,
        )
        self._sigma = np.zeros_like(self.state.surplus)  # of what was learnt last, by noise
        self._show()
        if not self.free.any():
            raise NotEnoughData(
                "closed loop: the limits of the projectors hold everywhere in the picture; choose another "
                "--picture, with mid-tones"
            )

    def update(self, seen: Array, sigma: Array, photographs: int) -> None:
        """Update by the mean (N, N, 3) of `photographs` with `sigma` each, and correct the picture."""
        self.learn(seen, sigma, photographs)
        down, up = self._margins()
        flat = (self._asked, self.goal, down, up)
        change = self._whole(self.state.step(*(self._flat(values) for values in flat)))
        self.correction += change
        self._show()

    def learn(self, seen: Array, sigma: Array, photographs: int) -> None:
        """Update the state by the mean (N, N, 3) of `photographs` of the picture shown."""
        light = self._asked
        highest, lowest = (f(light, NEAR, axes=(0, 1)) for f in (maximum_filter, minimum_filter))
        sigma = np.hypot(sigma / np.sqrt(photographs), STRAY * (highest - lowest))
        asked, seen, self._sigma = (self._flat(values) for values in (light, seen, sigma))
        known = self.known[self._inside]
        self.state.learn(LoopObservation(asked, seen, self._sigma, known, photographs))

    def residual(self, seen: Array) -> Array:
        """Goal less seen light (N, N, 3) [rel]; meaningful in `free` cells."""
        return self.goal - seen

    def residual_rms(self, residual: Array) -> float:
        """Root mean square over free cells and channels [rel]."""
        return float(np.sqrt(np.mean(residual[self.free] ** 2)))

    def gain_factor(self) -> Array:
        """Factor (N, N, 3) of the calibration's gain: direct light received per light asked for (L4)."""
        known, most = self.known[self._inside], 1 + MAX_GAIN_CHANGE
        change = gain_change(self.state.surplus, self._flat(self._asked), self._sigma, known)
        factor = np.clip(1 + change, 1 / most, most)
        return 1 + _filled(self._whole(factor - 1), self.known)

    def _show(self) -> None:
        """Compute the picture with the present correction, and the cells that can still change."""
        size = self._start.shape[0]
        seen = (self._cells.count > 0)[..., None]
        nodes = nodes_for_means(_filled(self.correction, seen | ~self._inside[..., None]))
        added = sample(nodes, master_pixels(master_directions(size)[0], LOOP_SIZE))
        corrected = np.clip(self._start + added, self._lo, self._hi)
        corrected = np.where(self._start > 0, corrected, 0)
        self.picture = np.where(self._protected, self._start, corrected).astype(np.float32)
        asked = np.clip(self.picture, self._lo, self._hi) * self._coverage
        self._asked = np.where(seen, self._cells.average_master(asked), _cell_means(asked))
        self._can_fall = self.cells_where(self.picture > self._lo + TINY) & self.known
        self._can_rise = self.cells_where(self.picture < self._hi - TINY) & self.known
        self.free = self._can_fall & self._can_rise

    def cells_where(self, pixels: BoolArray) -> BoolArray:
        """Cells (N, N, 3) in which almost all pixels of a dome master (M, M, 3) are true."""
        return self._cells.average_master(pixels.astype(np.float32)) > FREE_SHARE

    def _margins(self) -> tuple[Array, Array]:
        """Largest decrease and increase of the light of each cell (N, N, 3) [rel]."""
        low, high = (self._cells.average_master(limit) for limit in (self._lo, self._hi))
        down = np.where(self._can_fall, np.maximum(self._asked - low, 0), 0)
        return down, np.where(self._can_rise, np.maximum(high - self._asked, 0), 0)

    def _scatter(self, calibration: Calibration) -> PatchScatter:
        """Scatter kernel on the cells, b+ = U V^T b0."""
        maps, inside, kernel = calibration.maps, self._inside, calibration.maps.kernel
        scatter = sample(maps.scatter_per_flux, master_pixels(self.direction, maps.size))
        scatter, phi = scatter[inside], basis(self.direction[inside], kernel.degree)
        spread = [
            (scatter[:, c] / (phi @ kernel.profile[c]))[:, None] * (phi @ kernel.matrix[c])
            for c in range(3)
        ]
        solid = master_solid_angles(LOOP_SIZE)[inside]
        return PatchScatter(np.stack(spread), solid[:, None] * phi)

    def _low_pass(self, light: Array, known: BoolArray) -> Array:
        if self._low_pass_cells == 0:
            return light
        whole, mask = self._whole(light), self._whole(known) > 0
        smooth = [blur_within(whole[..., c], mask[..., c], self._low_pass_cells) for c in range(3)]
        return np.where(known, self._flat(np.stack(smooth, axis=-1).astype(float)), 0)

    def _flat(self, values: Array) -> Array:
        return values[self._inside]

    def _whole(self, values: NDArray[np.generic]) -> Array:
        whole = np.zeros((LOOP_SIZE, LOOP_SIZE, 3))
        whole[self._inside] = values
        return whole


def low_pass_cells(calibration: Calibration) -> float:
    """Sigma [cells] of the low-pass in addition to that of a cell's width.

    Together they are twice the registration error, the 95 % quantile of the standard error of the pixel
    directions. The mean over a cell is a low-pass of sigma 1/sqrt(12) cell.
    """
    surfaces = [p.surface for p in calibration.projectors.values()]
    sigma = np.concatenate(
        [s.sigma_arcmin[s.valid & np.isfinite(s.sigma_arcmin)] for s in surfaces]
    )
    registration = float(np.quantile(sigma, CELL_QUANTILE)) if sigma.size else 0.0
    wanted = 2 * registration / CELL_ARCMIN
    return float(np.sqrt(max(wanted**2 - 1 / 12, 0.0)))


def noise_by_level(photographs: list[Array], count: Array) -> Array:
    """Standard error (N, N, C) of the cells of one photograph, from several of the same picture.

    The variance of a camera pixel is taken to depend on the level alone, and averaged over groups of
    similar level. `count` (N, N) camera pixels per cell.
    """
    stack = np.stack(photographs)
    level, per_pixel = stack.mean(axis=0), stack.var(axis=0, ddof=1) * count[..., None]
    lit = np.broadcast_to(count[..., None] > 0, level.shape)
    order = np.argsort(level[lit])
    groups = np.array_split(order, LEVELS)
    middle = np.array([level[lit][g].mean() for g in groups])
    variance = np.array([per_pixel[lit][g].mean() for g in groups])
    found = np.interp(level, middle, variance) / np.maximum(count, 1)[..., None]
    return np.asarray(np.sqrt(found))


def _cell_means(master: Image) -> Array:
    """Means (N, N, C) of a dome master over the cells, from four samples of each."""
    direction, _ = master_directions(2 * LOOP_SIZE)
    fine = sample(master, master_pixels(direction, master.shape[0]))
    return block_mean(fine, 2).astype(float)


def _filled(values: Array, known: BoolArray) -> Array:
    """Values (N, N, C), interpolated from neighbours where not `known` (N, N, C or 1)."""
    known = np.broadcast_to(known, values.shape)
    planes = [blur_within(values[..., c], known[..., c], 1.0) for c in range(values.shape[-1])]
    return np.where(known, values, np.stack(planes, axis=-1))


def nodes_for_means(means: Array) -> Array:
    """Node values (N, N, C) whose bilinear interpolation has the given cell means.

    The mean over a cell weights its node and the neighbours 1/8, 3/4, 1/8 along each axis; Jacobi
    steps invert that. Otherwise the correction of fine structure would be half of what it needs.
    """
    nodes = means.copy()
    for _ in range(JACOBI_STEPS):
        blurred = nodes
        for axis in (0, 1):
            ends = np.roll(blurred, 1, axis) + np.roll(blurred, -1, axis)
            blurred = 0.75 * blurred + 0.125 * ends
        nodes = nodes + means - blurred
    return nodes
