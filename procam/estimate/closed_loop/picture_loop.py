"""The closed loop on the canvas: from photographs of a picture to a better picture and calibration.

Photographs and pictures are averaged over cells of a small canvas (`LoopCells`), on which
`LoopState` estimates what the calibration did not predict (docs/theory/closed-loop.md). `PictureLoop` keeps
the correction per cell, interpolates it to the picture between the limits of the projectors, and repeats.
`refined.refined_calibration` turns the estimates into a new calibration.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, maximum_filter, minimum_filter

from procam.arrays import Array, BoolArray, Image, IndexArray
from procam.errors import NotEnoughData
from procam.estimate.closed_loop.gains import gain_change
from procam.estimate.closed_loop.patches import CELL_QUANTILE, LoopObservation, LoopState
from procam.estimate.closed_loop.screen_scatter import scatter_of
from procam.maths.geometry.sphere import ARCMIN
from procam.maths.warp import block_mean, blur_within, pixel_places, sample
from procam.model.calibration import Calibration
from procam.model.screen import ContentCanvas, Dome, Screen

LOOP_SIZE = 256  # cells along the width of the canvas
BLOCK = 32  # cells, 22 degrees of a dome: errors of gains further apart are taken as independent
FREE_SHARE = 0.98  # of a cell that must satisfy a condition
MAX_GAIN_CHANGE = 0.25  # factor up to 1 + this, down to its inverse
TINY = 1e-5  # of white, between a value and a limit that it has reached
NEAR, STRAY = 7, 0.05  # cells that lens stray light reaches, and its share of their contrast
LEVELS = 16  # groups of equal level, for the noise
JACOBI_STEPS = 6


@dataclass(frozen=True, slots=True)
class LoopCells:
    """Assignment of camera pixels to the cells of a small canvas.

    `use` (H, W) are the camera's pixels that see the canvas; `index` (K,) is the cell of each. `place`
    (H, W, 2) is where they look, from the canvas's upper left corner (0, 0) to its lower right (1, 1).
    `count` (N, M) is the number of pixels per cell.
    """

    use: BoolArray
    index: IndexArray
    place: Image
    count: Array

    @classmethod
    def of(cls, canvas: ContentCanvas, direction: Image, on_screen: BoolArray) -> "LoopCells":
        """Cells for a camera with pixel directions (H, W, 3) where `on_screen` (H, W)."""
        rows, columns = canvas.shape(LOOP_SIZE)
        where = canvas.pixels(direction[on_screen], LOOP_SIZE)
        cell = np.rint(where).astype(np.intp)
        inside = np.all((cell >= 0) & (cell < (columns, rows)), axis=-1)
        use = on_screen.copy()
        use[on_screen] = inside
        index = cell[inside, 1] * columns + cell[inside, 0]
        count = np.bincount(index, minlength=rows * columns).astype(float).reshape(rows, columns)
        place = np.full((*use.shape, 2), -1, np.float32)
        place[use] = (where[inside] + 0.5) / (columns, rows)
        return cls(use, index, place, count)

    def average(self, light: Image) -> Array:
        """Cell means (N, M, C) of a camera picture (H, W, C)."""
        return self._means(light[self.use])

    def average_of(self, picture: Image) -> Array:
        """Cell means (N, M, C) of a picture on the canvas, sampled where the camera's pixels look."""
        size = np.array(picture.shape[1::-1])
        where = np.clip(self.place * size - 0.5, 0, size - 1)
        return self._means(sample(picture, where)[self.use])

    def _means(self, values: Image) -> Array:
        sums = [np.bincount(self.index, values[:, c], self.count.size) for c in range(3)]
        means = np.stack(sums, axis=-1).reshape(*self.count.shape, 3)
        return means / np.maximum(self.count, 1)[..., None]


class PictureLoop:
    """The closed loop on one picture, over cells of the canvas.

    The correction is bilinear between cells, clipped to the limits of each pixel, and low-passed at
    twice the registration error where that exceeds a cell's width.

    Parameters
    ----------
    calibration, cells : the screen, and the camera's cells.
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
        maps, canvas = calibration.maps, calibration.screen.canvas
        self._cells, self._start, self._shape = cells, direct, cells.count.shape
        where = pixel_places(direct.shape, maps.coverage.shape)
        coverage = sample(maps.coverage, where)
        self._coverage = coverage[..., None]
        self._lo = sample(maps.lo, where)
        # hi is multiplied by coverage, but a pixel on the border can be driven fully where it is lit
        self._hi = np.maximum(sample(maps.hi, where) / np.maximum(self._coverage, 0.5), self._lo)
        self._protected = (maps.is_protected(where) & (coverage > 0))[..., None]
        self.direction, self._inside = canvas.directions(LOOP_SIZE)
        ours = (coverage * ~self._protected[..., 0])[..., None].repeat(3, axis=-1)
        known = (cells.average_of(ours) > FREE_SHARE) & (cells.count > 0)[..., None]
        self.known = known & self._inside[..., None]
        self.goal = cells.average_of(target)
        self.correction = np.zeros((*self._shape, 3))
        row, column = (index // BLOCK for index in np.indices(self._shape))
        self.block = row * (1 + column.max()) + column
        self._low_pass_cells = low_pass_cells(calibration)
        m = calibration.feedback
        self.state = LoopState(
            scatter_of(calibration, LOOP_SIZE),
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
        seen = (self._cells.count > 0)[..., None]
        nodes = nodes_for_means(_filled(self.correction, seen | ~self._inside[..., None]))
        added = sample(nodes, pixel_places(self._start.shape, self._shape))
        corrected = np.clip(self._start + added, self._lo, self._hi)
        corrected = np.where(self._start > 0, corrected, 0)
        self.picture = np.where(self._protected, self._start, corrected).astype(np.float32)
        asked = np.clip(self.picture, self._lo, self._hi) * self._coverage
        own = _cell_means(asked, self._shape)
        self._asked = np.where(seen, self._cells.average_of(asked), own)
        self._can_fall = self.cells_where(self.picture > self._lo + TINY) & self.known
        self._can_rise = self.cells_where(self.picture < self._hi - TINY) & self.known
        self.free = self._can_fall & self._can_rise

    def cells_where(self, pixels: BoolArray) -> BoolArray:
        """Cells (N, N, 3) in which almost all pixels of a picture (M, M, 3) are true."""
        return self._cells.average_of(pixels.astype(np.float32)) > FREE_SHARE

    def _margins(self) -> tuple[Array, Array]:
        """Largest decrease and increase of the light of each cell (N, N, 3) [rel]."""
        low, high = (self._cells.average_of(limit) for limit in (self._lo, self._hi))
        down = np.where(self._can_fall, np.maximum(self._asked - low, 0), 0)
        return down, np.where(self._can_rise, np.maximum(high - self._asked, 0), 0)

    def _low_pass(self, light: Array, known: BoolArray) -> Array:
        if self._low_pass_cells == 0:
            return light
        whole, mask = self._whole(light), self._whole(known) > 0
        smooth = [blur_within(whole[..., c], mask[..., c], self._low_pass_cells) for c in range(3)]
        return np.where(known, self._flat(np.stack(smooth, axis=-1).astype(float)), 0)

    def _flat(self, values: Array) -> Array:
        return values[self._inside]

    def _whole(self, values: NDArray[np.generic]) -> Array:
        whole = np.zeros((*self._shape, 3))
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
    wanted = 2 * registration / cell_arcmin(calibration.screen)
    return float(np.sqrt(max(wanted**2 - 1 / 12, 0.0)))


def cell_arcmin(screen: Screen) -> float:
    """Width of a cell, in a room as seen from its middle."""
    if isinstance(screen, Dome):
        return float(np.degrees(screen.canvas.fov) * 60 / LOOP_SIZE)
    direction, lit = screen.canvas.directions(LOOP_SIZE)
    far_m = float(np.median(screen.shape.radius_at(direction[lit])))
    return screen.room.size_m[0] / LOOP_SIZE / far_m * ARCMIN


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


def _cell_means(picture: Image, shape: tuple[int, ...]) -> Array:
    """Means (N, M, C) of a picture over cells (N, M), from four samples of each."""
    fine = sample(picture, pixel_places((2 * shape[0], 2 * shape[1]), picture.shape))
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
            blurred = correlate1d(blurred, (0.125, 0.75, 0.125), axis, mode="nearest")
        nodes = nodes + means - blurred
    return nodes
