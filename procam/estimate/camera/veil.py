"""The part of a lens's veil that stays near its light, and a bound of all of it where none was measured.

The near part is found from dark stripes (docs/theory/photometry.md). No lens is without a veil, and no light
trap gives exactly 0. The veil reaches every pixel, so there is no more of it than light in the darkest place
of a photograph, and nothing else bounds a glare of 0 in venue.toml.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls
from scipy.special import stdtrit

from procam.arrays import Array, BoolArray, FloatArray, Image
from procam.maths.warp import block_mean, blur_in_dark, enlarged, grow
from procam.model.optics import Sensor
from procam.model.provenance import Note

# of the Gaussians that make up the veil [of the picture's shorter side]; what the last one takes is no
# veil of the lens, but gloss and the floor
SPREADS = (0.02, 0.03, 0.045, 0.07, 0.1, 0.15)
CELL_PX = 4  # edge of the cells on which light is spread, and dark light compared with less noise
EDGE_PX = (
    4  # off the edge of what counts as dark: a trace of blurred light would look like a near veil
)
DARK_SHARE = 0.5  # of a cell
FEWEST = 1000  # dark cells of all pictures
LEAST = 1e-9  # of the normal equations' eigenvalues
CERTAIN = 0.975  # quantile of Student's t
MIN_SHARE = 0.05  # of the flux of white: with less there is nothing to scatter
UNMEASURED = 0.01  # standard error of a glare of 0 by somebody who does not know it
MOST = 0.05  # share of the light that a lens veils at most: by ISO 9358 good ones 0.5 to 3 %
DARKEST = 0.01  # quantile of the cells
UNIFORM = 3**-0.5  # standard error of a value between 0 and 1, about 0
WIDER = 2.0  # times the stated standard error: less is no contradiction


def near_veil(light: Image, parts: Sequence[tuple[float, float]]) -> Image:
    """Veil (H, W[, C]) of light (H, W[, C]) by Gaussians: (share, spread [of the shorter side]) each."""
    cells = block_mean(light, CELL_PX)
    veil = sum((np.float32(share) * _spread(cells, spread) for share, spread in parts), 0 * cells)
    return enlarged(veil, light.shape[:2])


def _spread(cells: Image, spread: float) -> Image:
    """Light of cells (h, w[, C]), spread; beyond the picture there is none."""
    return blur_in_dark(cells, spread * min(cells.shape[:2]))


class NearVeilFit:
    """Finds how much of a lens's veil stays near its light, and how near.

    A place that is dark in several pictures sees scattered light in proportion to their flux. What
    differs, less that, is the veil of the bright stripes around it, which lie elsewhere in each picture.

    Parameters
    ----------
    seen : (H, W) pixels of the image circle.
    """

    def __init__(self, seen: BoolArray) -> None:
        self._seen = seen
        cells = block_mean(seen.astype(np.float32), CELL_PX).shape
        self._weight = np.zeros(cells, np.float32)
        self._dark = np.zeros(cells, np.float32)
        self._veil = np.zeros((len(SPREADS), *cells), np.float32)
        self._squares, self._products = np.zeros((len(SPREADS),) * 2), np.zeros(len(SPREADS))
        self._groups = list[tuple[Array, Array]]()
        self._compared = 0

    def add(self, light: Image, dark: BoolArray, share: FloatArray | float) -> None:
        """Add a picture of one projector.

        Parameters
        ----------
        light : (H, W) less black, an even veil subtracted. dark : (H, W) sees scattered light alone.
        share : scattered light of the picture over that of white, one number or (H, W).
        """
        each = block_mean(np.broadcast_to(np.float32(share), light.shape), CELL_PX)
        dark = grow(dark, -EDGE_PX)
        known = block_mean(dark.astype(np.float32), CELL_PX)
        use = known > DARK_SHARE
        level = block_mean(np.where(dark, light, 0), CELL_PX) / np.maximum(known, DARK_SHARE)
        shining = np.where(self._seen, np.nan_to_num(light), 0).astype(np.float32)
        cells = block_mean(shining, CELL_PX)
        # scattered light over its share has the weight of that share squared
        self._weight += use * each**2
        self._dark += use * each * level
        self._compared += int((use & (each > MIN_SHARE)).sum())
        veil = np.stack([use * _spread(cells, spread) for spread in SPREADS])
        self._veil += each * veil
        self._squares += _products(veil, veil)
        self._products += _products(veil, level)

    def end_group(self) -> None:
        """Start with pictures of another projector or axis; of those so far, what differs counts."""
        weight = np.maximum(self._weight, MIN_SHARE**2)
        self._squares -= _products(self._veil, self._veil / weight)
        self._products -= _products(self._veil, self._dark / weight)
        self._groups.append((self._squares.copy(), self._products.copy()))
        for sums in (self._weight, self._dark, self._veil, self._squares, self._products):
            sums[...] = 0

    def extend(self, other: "NearVeilFit") -> None:
        """Add the groups of another fit."""
        self._groups += other._groups
        self._compared += other._compared

    def result(self) -> list[tuple[float, float]]:
        """Share of the light, and spread [of the shorter side], of each Gaussian that there is.

        The lens is the same for all groups. None if they contradict each other: by the standard error of
        their jackknife, all shares together may be zero.
        """
        count, every = len(self._groups), range(len(self._groups))
        if self._compared < FEWEST or count == 1:  # one group can contradict nothing
            return []
        near = _shares(self._groups)
        others = [_shares([self._groups[i] for i in every if i != left]).sum() for left in every]
        error = np.sqrt((count - 1) * np.var(others))
        if near.sum() <= stdtrit(count - 1, CERTAIN) * error:
            return []
        return [(float(x), spread) for x, spread in zip(near, SPREADS, strict=False) if x > 0]


def _shares(groups: Sequence[tuple[Array, Array]]) -> Array:
    """Shares of the Gaussians but the widest, from groups' normal equations A x = b; none negative."""
    squares, products = (np.sum(sums, axis=0) for sums in zip(*groups, strict=True))
    scale = np.sqrt(np.maximum(np.diag(squares), 1e-30))
    eigenvalue, axes = np.linalg.eigh(squares / np.outer(scale, scale))
    root = np.sqrt(np.maximum(eigenvalue, LEAST))
    shares, _ = nnls(root[:, None] * axes.T, axes.T @ (products / scale) / root)
    return np.asarray((shares / scale)[:-1])


def _products(first: FloatArray, second: FloatArray) -> Array:
    """Sums (..., ...) over cells of products of images (..., h, w)."""
    axes = ((-2, -1), (-2, -1))
    return np.tensordot(first.astype(float), second.astype(float), axes)


def darkest_share(light: Image, seen: BoolArray) -> float:
    """Light (H, W) in the darkest place of the image circle over the mean; at least 0, and noise."""
    whole = block_mean(seen.astype(np.float32), CELL_PX) == 1
    cells = block_mean(np.nan_to_num(light), CELL_PX)[whole]
    mean = float(np.nan_to_num(light)[seen].mean()) if seen.any() else 0.0
    if not (cells.size and mean > 0):
        return MOST
    return max(0.0, float(np.quantile(cells, DARKEST)) / mean)


def bounded_glare(sensor: Sensor, darkest: float) -> Sensor:
    """The sensor, with a wider standard error of a glare of 0 if light in the darkest place allows more.

    Parameters
    ----------
    darkest : `darkest_share` of a photograph; the least of several.
    """
    bound = UNIFORM * min(darkest, MOST)
    stated = sensor.glare_sigma
    if sensor.glare > 0 or stated >= UNMEASURED or bound <= WIDER * stated:
        return sensor
    return replace(sensor, glare_sigma=bound)


def glare_notes(camera: str, stated: Sensor, bounded: Sensor, darkest: float) -> list[Note]:
    """A note if the standard error of the glare was not trusted."""
    if bounded.glare_sigma == stated.glare_sigma:
        return []
    text = (
        f"venue.toml has glare = 0 with glare_sigma = {stated.glare_sigma:g}, but no "
        f"lens is without a veil, and the darkest place in its pictures has {darkest:.1%} of their mean "
        f"light; m and albedo may be too large, and their standard errors are by glare_sigma = "
        f"{bounded.glare_sigma:.2g}. Measure it with `procam lens glare`"
    )
    return [Note("glare unknown", f"camera {camera}", text)]
