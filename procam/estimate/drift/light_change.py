"""Change of the light of each projector, and of the screen, from photographs of full white.

At a place of the dome the paint cancels in the ratio of two photographs, so the ratio is that of the lamps,
of the camera's exposure and of what has settled on the screen since. A picture that moved has light of
another part of the panel there, spread over another area; both follow from the motion and the light before.
"""

from dataclasses import dataclass, replace

import numpy as np

from procam.arrays import Array, Image
from procam.estimate.drift.displacement import Motion, grid_places, window_slices
from procam.estimate.drift.pictures import PanelGrid
from procam.maths.statistics import MEDIAN_SIGMA, NORMAL_MAD
from procam.maths.warp import grow

WINDOWS = 32, 20  # across and down
LEAST_KNOWN = 0.8  # of a window
MARGIN = 6  # grid px from the edge of the light, where blur and motion change it
DARKEST = 1e-4  # of the light before
SMOOTH_DEGREE = 4  # of the panel's flux
FIT_EVERY = 4  # points of the grid, for its fit
# relative, of a channel: what a camera's gain does between two sessions, a degree of its sensor
CAMERA_SIGMA = 5e-4


@dataclass(frozen=True, slots=True)
class WindowLight:
    """Light of windows of a panel over that of before.

    `direction` (n, 3) on the dome; `log_ratio` (n, 3) of each primary. `scattered` (n,) is the share of
    scattered light in what was seen before.
    """

    direction: Array
    log_ratio: Array
    scattered: Array

    def without_scatter(self, ratio: Array) -> "WindowLight":
        """The same where scattered light per direct light is `ratio` (3,) times what it was."""
        change = np.log1p(self.scattered[:, None] * (ratio - 1))
        return replace(self, log_ratio=self.log_ratio - change)

    def level(self, of_dome: Array | None = None) -> tuple[Array, Array]:
        """Median (3,) over the windows, less the dome's own change (n,), and its standard error (3,)."""
        values = self.log_ratio - (0.0 if of_dome is None else of_dome[:, None])
        if not len(values):
            return np.full(3, np.nan), np.full(3, np.nan)
        level = np.median(values, axis=0)
        spread = NORMAL_MAD * np.median(np.abs(values - level), axis=0)
        return level, np.hypot(MEDIAN_SIGMA * spread / np.sqrt(len(values)), CAMERA_SIGMA)


def white_ratio(
    grid: PanelGrid,
    before: Image,
    now: Image,
    mix: Array,
    scattered: Image,
    motion: Motion | None,
) -> WindowLight:
    """Light of full white over that of before, by windows of a panel.

    Parameters
    ----------
    before, now : (h, w, 3) at the panel's points, NaN where unknown.
    mix : (3, 3) the projector's colour mix in the channels of the pictures.
    scattered : (h, w) share of scattered light in `before`.
    motion : of the light; None where it stayed and only the picture in it moved.
    """
    inner = grow(np.pad(grid.valid, MARGIN), -MARGIN)[MARGIN:-MARGIN, MARGIN:-MARGIN]
    known = inner & np.isfinite(before).all(axis=-1) & (before > 0).all(axis=-1)
    ratio = np.where(known[..., None], now / np.where(known[..., None], before, 1), np.nan)
    if motion is not None:
        flux = before.sum(axis=-1) * (1 - scattered) * grid.solid_angle
        direct = np.exp(moved_flux(np.where(known, flux, np.nan), motion))
        ratio = ratio / ((1 - scattered) * direct + scattered)[..., None]
    rows = [
        row
        for part in window_slices(grid.shape, WINDOWS)
        if (row := _window(grid, ratio, scattered, part))
    ]
    if not rows:
        return WindowLight(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    direction, values, shares = (np.array(column) for column in zip(*rows, strict=True))
    primaries = values @ np.linalg.inv(mix / mix.sum(axis=1, keepdims=True)).T
    return WindowLight(direction, np.log(np.maximum(primaries, DARKEST)), shares)


def _window(
    grid: PanelGrid, ratio: Image, scattered: Image, part: tuple[slice, slice]
) -> tuple[Array, Array, float] | None:
    """Direction (3,), median ratio (3,) and scattered share of a window; None if it is not seen."""
    inside = ratio[part].reshape(-1, 3)
    good = np.isfinite(inside).all(axis=1)
    if good.mean() < LEAST_KNOWN:
        return None
    middle = grid.direction[part].reshape(-1, 3)[good].mean(axis=0, dtype=float)
    share = float(scattered[part].ravel()[good].mean())
    return middle / np.linalg.norm(middle), np.median(inside[good], axis=0), share


def moved_flux(flux: Image, motion: Motion) -> Array:
    """Log (h, w) of the light at each place of a panel after a motion, over that before it.

    `flux` (h, w) is light times area; its logarithm is taken to be a polynomial.
    """
    shape = flux.shape[0], flux.shape[1]
    grid = grid_places(shape)
    good, basis = np.isfinite(flux) & (flux > 0), _powers(grid, shape)
    some = np.s_[::FIT_EVERY, ::FIT_EVERY]
    known = good[some]
    fitted = np.linalg.lstsq(basis[some][known], np.log(flux[some][known]), rcond=None)
    coefficients = fitted[0]
    shift = motion.at(grid)
    stretch = [np.gradient(shift[..., i], axis=axis) for i in (0, 1) for axis in (1, 0)]
    xx, xy, yx, yy = stretch
    area = (1 + xx) * (1 + yy) - xy * yx
    return np.asarray(
        _powers(grid - shift, shape) @ coefficients - basis @ coefficients - np.log(area)
    )


def _powers(place: Array, shape: tuple[int, int]) -> Array:
    """Monomials (..., K) of places (..., 2) on a grid, scaled to -1..1."""
    x, y = (2 * place[..., i] / (n - 1) - 1 for i, n in enumerate(shape[::-1]))
    return np.stack(
        [x**i * y**j for i in range(SMOOTH_DEGREE + 1) for j in range(SMOOTH_DEGREE + 1 - i)],
        axis=-1,
    )
