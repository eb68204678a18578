"""Measures where a panel's picture went, and its further blur, from pictures of shuffled tiles.

Digital image correlation: the texture of the tiles, once found (`coarse_windows`), is followed to hundredths
of a pixel in small windows by least squares, with gain, offset and blur of each as unknowns too. A projective
motion of the whole panel is fitted to the windows.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from procam.arrays import Array, Image
from procam.maths.statistics import robust_sigma
from procam.maths.warp import blur

Sampler = Callable[[Array], Image]
TERMS = 8  # of a projective motion
BLOCKS = 8, 5  # fine windows, across and down
LEAST_POINTS = 60  # of a window
LEAST_SHARE = 0.4  # of a window that must be known
ROUNDS = 5
SETTLED = 0.02  # grid px, and grid px^2 of blur: further rounds change nothing
FIT_ROUNDS = 12
HUBER = 2.0  # sigmas beyond which a window counts less
LEAST_SIGMA = 0.0015  # grid px: interpolation of a photograph
LARGEST_BLUR2 = 30.0  # grid px^2


@dataclass(frozen=True, slots=True)
class Windows:
    """Displacements of windows of a panel.

    Attributes
    ----------
    place : (n, 2) their middles on the grid. shift : (n, 2) to where their picture went [grid px].
    sigma : (n,) standard error of each component of the shift. blur2 : (n,) rise of the variance of the blur
    [grid px^2]; NaN of coarse windows.
    """

    place: Array
    shift: Array
    sigma: Array
    blur2: Array


@dataclass(frozen=True, slots=True)
class Motion:
    """A projective displacement of a panel's picture, in units of half the panel's width.

    With x, y from the middle in those units, the displacement is (a0 + a1 x + a2 y + x (g x + h y),
    b0 + b1 x + b2 y + y (g x + h y)); `terms` (8,) are a0, a1, a2, b0, b1, b2, g, h and `covariance`
    (8, 8) theirs.
    """

    shape: tuple[int, int]
    terms: Array
    covariance: Array

    def at(self, place: Array) -> Array:
        """Displacement (..., 2) [grid px] of places (..., 2) on the grid."""
        return (_rows(place, self.shape) @ self.terms) * (self.shape[1] / 2)

    def rms(self, place: Array) -> tuple[float, float]:
        """Root mean square displacement of places (n, 2), and its standard error [grid px]."""
        rows = _rows(place, self.shape) * (self.shape[1] / 2)
        moved, count = rows @ self.terms, len(place)
        slope = 2 * np.einsum("nik,ni->k", rows, moved) / count
        noise = float(np.einsum("nik,kl,nil->", rows, self.covariance, rows)) / count
        square = float(np.sum(moved**2)) / count - noise  # noise adds to a mean square
        if square <= noise:
            return float(np.sqrt(max(square, 0.0))), float(np.sqrt(noise))
        length = float(np.sqrt(square))
        return length, float(np.sqrt(slope @ self.covariance @ slope)) / (2 * length)


def unmoved(shape: tuple[int, int]) -> Motion:
    """No displacement."""
    return Motion(shape, np.zeros(TERMS), np.zeros((TERMS, TERMS)))


def _rows(place: Array, shape: tuple[int, int]) -> Array:
    """Derivatives (..., 2, 8) of the displacement by the terms."""
    half = shape[1] / 2
    x = (place[..., 0] - (shape[1] - 1) / 2) / half
    y = (place[..., 1] - (shape[0] - 1) / 2) / half
    one, zero = np.ones_like(x), np.zeros_like(x)
    across = np.stack([one, x, y, zero, zero, zero, x * x, x * y], axis=-1)
    down = np.stack([zero, zero, zero, one, x, y, x * y, y * y], axis=-1)
    return np.stack([across, down], axis=-2)


def fit_motion(windows: Windows, shape: tuple[int, int]) -> Motion:
    """The projective motion of windows, by iteratively reweighted least squares (Huber)."""
    rows = _rows(windows.place, shape) * (shape[1] / 2)
    sigma = np.hypot(windows.sigma, LEAST_SIGMA)
    terms, extra = np.zeros(TERMS), 0.0
    for _ in range(FIT_ROUNDS):
        spread = np.hypot(sigma, extra)
        away = np.linalg.norm(windows.shift - rows @ terms, axis=-1) / spread
        weight = np.minimum(1, HUBER / np.maximum(away, 1e-9)) / spread**2
        normal = np.einsum("n,nik,nil->kl", weight, rows, rows)
        normal += 1e-9 * np.trace(normal) / TERMS * np.eye(TERMS)
        terms = np.linalg.solve(normal, np.einsum("n,nik,ni->k", weight, rows, windows.shift))
        residual = (windows.shift - rows @ terms).ravel()
        freedom = max(1.0, residual.size - TERMS) / residual.size
        found = robust_sigma(residual, 0.0) / np.sqrt(freedom)
        extra = float(np.sqrt(max(0.0, found**2 - float(np.median(sigma)) ** 2)))
    return Motion(shape, terms, np.linalg.inv(normal))


def follow(before: Image, photograph: Sampler, start: Motion) -> tuple[Motion, Windows]:
    """The motion of a texture (h, w), and its windows, to hundredths of a grid pixel.

    `photograph(places)` gives the texture of today at places (h, w, 2) on the grid.
    """
    shape = before.shape[0], before.shape[1]
    grid, motion, blur2 = grid_places(shape), start, 0.0
    for _ in range(ROUNDS):
        pair = _as_sharp(before, photograph(grid + motion.at(grid)), blur2)
        windows = _windows(*pair, grid, motion)
        if len(windows.place) <= TERMS // 2:
            return motion, windows
        # noise of the picture that is differentiated looks like blur of the other: take turns
        back = _windows(*pair[::-1], grid, motion)
        more = float(np.median(windows.blur2) - np.median(back.blur2)) / 2
        blur2 = float(np.clip(blur2 + more, -LARGEST_BLUR2, LARGEST_BLUR2))
        step = windows.shift - motion.at(windows.place)
        motion = fit_motion(windows, shape)
        if np.abs(step).max() < SETTLED and abs(more) < SETTLED:
            break
    each = windows.blur2 - np.median(windows.blur2) + blur2
    return motion, replace(windows, blur2=each)


def grid_places(shape: tuple[int, int]) -> Array:
    """Places (h, w, 2) of a grid's points on itself."""
    return np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), -1).astype(float)


def _as_sharp(before: Image, today: Image, blur2: float) -> tuple[Image, Image]:
    """Both textures, the sharper one blurred by the variance that the other has more."""
    if blur2 > 1e-3:
        return blurred(before, blur2), today
    if blur2 < -1e-3:
        return before, blurred(today, -blur2)
    return before, today


def blurred(image: Image, variance: float) -> Image:
    """An image (h, w[, C]) blurred where it is known; NaN near what is not."""
    known = np.asarray(np.isfinite(image).reshape(*image.shape[:2], -1).all(axis=-1))
    shaped = (..., None) if image.ndim == 3 else (...,)
    soft = blur(np.where(known[shaped], image, 0), float(np.sqrt(variance)))
    share = blur(known.astype(np.float32), float(np.sqrt(variance)))
    inside = known & (share > 0.999)
    return np.where(inside[shaped], soft / np.maximum(share, 0.5)[shaped], np.float32(np.nan))


def _windows(base: Image, seen: Image, grid: Array, motion: Motion) -> Windows:
    """Least squares in each window: gain, offset, displacement and blur."""
    rise_y, rise_x = np.gradient(base)
    curve = np.gradient(rise_x, axis=1) + np.gradient(rise_y, axis=0)
    layers = np.stack([seen, base, rise_x, rise_y, curve, np.ones_like(base)], axis=-1)
    rows = list[tuple[Array, Array, float, float]]()
    for window in window_slices(base.shape, BLOCKS):
        part = layers[window].reshape(-1, 6).astype(float)
        good = np.isfinite(part).all(axis=1)
        if good.sum() < max(LEAST_POINTS, LEAST_SHARE * part.shape[0]):
            continue
        fit = _fitted(part[good])
        if fit is None:
            continue
        shift, sigma, blur2 = fit
        middle = grid[window].reshape(-1, 2)[good].mean(axis=0)
        rows.append((middle, shift, sigma, blur2))
    if not rows:
        return Windows(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    place, rest, sigmas, blurs = (np.array(column) for column in zip(*rows, strict=True))
    return Windows(place, motion.at(place) + rest, sigmas, blurs)


def window_slices(
    shape: tuple[int, ...], across_down: tuple[int, int]
) -> list[tuple[slice, slice]]:
    """So many windows across and down of a grid (h, w), row by row."""
    across, down = (
        [slice(a, b) for a, b in pairwise(np.linspace(0, n, count + 1).astype(int))]
        for n, count in zip(shape[1::-1], across_down, strict=True)
    )
    return [(rows, columns) for rows in down for columns in across]


def _fitted(part: Array) -> tuple[Array, float, float] | None:
    """Remaining shift (2,), its standard error and rise of the blur's variance of one window."""
    seen, columns = part[:, 0], part[:, 1:]
    normal = columns.T @ columns
    if np.linalg.cond(normal) > 1e12:
        return None
    found = np.linalg.solve(normal, columns.T @ seen)
    gain = found[0]
    if gain <= 0:
        return None
    noise = float(np.mean((seen - columns @ found) ** 2)) * len(seen) / max(1, len(seen) - 5)
    inverse = np.linalg.inv(normal) * noise / gain**2
    return -found[1:3] / gain, float(np.sqrt(inverse[1:3, 1:3].trace() / 2)), 2 * found[3] / gain
