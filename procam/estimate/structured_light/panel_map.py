"""Where each patch of a projector's panel is seen, fitted over the camera pixels that see it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procam.estimate.structured_light.outliers import keep_only
from procam.model.correspondence import CorrespondenceMap, ProjectorMap

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
PIXELS_PER_PATCH = 72  # enough to bring .3 px down to .04
SMALLEST_PATCH_PX = 4
FEWEST_PIXELS = 12
BLOCK = 4  # patches along the edge of a block, over which curvature is alike
FULL_BLOCK = BLOCK**2 / 2  # patches of it that must be seen
INSIDE = 0.2  # the patch's centre may miss the mean place by this share of the patch
FAR = 3.0  # spreads of a patch from its middle; a parallelogram reaches to 2.45 at most
SIGMAS = 6.0
SHARED_PX = 0.0025  # what neighbouring pixels share of their error at least (studies/codes.md)
MISFIT_PX = 0.5  # what the fit may leave beyond noise
ROUNDS = 2


@dataclass(frozen=True, slots=True)
class _Fits:
    """Projector = bend(camera) + line (1, camera - middle) in each of P patches.

    The bend, of blocks of patches, takes the curvature that straight lines cannot follow.
    `middle` (P, 2), `line` (P, 3, 2) with the inverse of its normal matrix (P, 3, 3); `block` (P,)
    of each patch, their `block_middle` (B, 2) and `bend` (B, 3, 2); `count` (P,); `shared_px2` (P,)
    variance that the pixels of a patch have in common.
    """

    middle: Array
    line: Array
    inverse: Array
    block: Index
    block_middle: Array
    bend: Array
    count: Array
    shared_px2: Array

    def predict(self, patch: Index, camera_px: Array) -> Array:
        """Projector pixel (N, 2) by each pixel's own patch."""
        near = camera_px - self.middle[patch]
        lines = self.line[patch]
        straight = lines[:, 0] + near[:, :1] * lines[:, 1] + near[:, 1:] * lines[:, 2]
        return straight + self.bent(patch, camera_px)

    def bent(self, patch: Index, camera_px: Array) -> Array:
        """The curved part (N, 2)."""
        block = self.block[patch]
        u, v = (camera_px - self.block_middle[block]).T[..., None]
        bend = self.bend[block]
        return u * u * bend[:, 0] + u * v * bend[:, 1] + v * v * bend[:, 2]

    def slope(self, patch: Index, camera_px: Array) -> Array:
        """Projector pixels per camera pixel (N, 2, 2) at camera pixels (N, 2)."""
        block = self.block[patch]
        u, v = (camera_px - self.block_middle[block]).T[..., None]
        bend, line = self.bend[block], self.line[patch]
        across = line[:, 1] + 2 * u * bend[:, 0] + v * bend[:, 1]
        down = line[:, 2] + u * bend[:, 1] + 2 * v * bend[:, 2]
        return np.stack([across, down], axis=-1)


def fit_projector_map(found: CorrespondenceMap, size: tuple[int, int]) -> ProjectorMap:
    """The panel's side of a map: per patch the camera pixel where its centre is seen.

    Least squares of the projector coordinates on the camera pixels, whose places are exact; twice,
    since noise moves pixels over the borders between patches.
    """
    rows, columns = np.nonzero(found.valid)
    camera_px = np.stack([columns, rows], axis=1).astype(float)
    xy = found.projector_xy[found.valid].astype(float)
    sigma = np.maximum(found.sigma_px[found.valid].astype(float), 1e-6)
    shared = (
        np.zeros_like(xy) if found.shared_px is None else found.shared_px[found.valid].astype(float)
    )
    patch_px = patch_size(xy)
    shape = (-(-size[1] // patch_px), -(-size[0] // patch_px))
    place, use = xy, _together(_patch_index(xy, patch_px, shape), camera_px, shape)
    for _ in range(ROUNDS):
        index = _patch_index(place, patch_px, shape)
        fits = _fit(index[use], camera_px[use], xy[use], sigma[use], shared[use], shape)
        place = fits.predict(index, camera_px)
        use = (np.abs(xy - place) <= MISFIT_PX + SIGMAS * sigma).all(axis=1)
        use &= fits.count[index] >= FEWEST_PIXELS
        place = np.where(use[:, None], place, xy)
    return _at_centres(fits, patch_px, shape)


def patch_size(xy: Array) -> int:
    """Edge [px] of patches that some 72 of the camera pixels that see xy (N, 2) fall into."""
    if not len(xy):
        return SMALLEST_PATCH_PX
    cells = np.unique(
        np.floor(xy / 16).astype(np.int32) @ np.array([1, 1 << 14]), return_counts=True
    )
    density = float(np.median(cells[1])) / 16**2
    return max(SMALLEST_PATCH_PX, round(float(np.sqrt(PIXELS_PER_PATCH / density))))


def drop_inconsistent(found: CorrespondenceMap, seen: ProjectorMap) -> CorrespondenceMap:
    """Drop camera pixels that their patch, looked up through the panel, expects elsewhere.

    Forward from camera to panel, back by the patch's fit: what does not come home is misread.
    Pixels of patches without a fit are kept; nothing contradicts them.
    """
    rows, columns = np.nonzero(found.valid)
    xy, sigma = found.projector_xy[found.valid], found.sigma_px[found.valid]
    height, width = seen.valid.shape
    patch = np.clip((xy + 0.5) / seen.patch_px, 0, [width - 1e-3, height - 1e-3]).astype(int)
    at = (patch[:, 1], patch[:, 0])
    home = np.stack([columns, rows], axis=1) - seen.camera_px[at]
    centre = (patch + 0.5) * seen.patch_px - 0.5
    miss = np.abs(xy - centre - np.einsum("nij,nj->ni", seen.slope[at], home))
    ok = (miss <= MISFIT_PX + SIGMAS * sigma).all(axis=1) | ~seen.valid[at]
    keep = np.zeros_like(found.valid)
    keep[rows[ok], columns[ok]] = True
    return keep_only(found, keep)


def _patch_index(place: Array, patch_px: int, shape: tuple[int, int]) -> Index:
    cell = np.floor((place + 0.5) / patch_px).astype(int)
    column, row = np.clip(cell, 0, [shape[1] - 1, shape[0] - 1]).T
    return np.asarray(row * shape[1] + column, np.intp)


def _fit(
    index: Index,
    camera_px: Array,
    xy: Array,
    sigma: Array,
    shared: Array,
    shape: tuple[int, int],
) -> _Fits:
    patches = shape[0] * shape[1]
    blocks = (-(-shape[0] // BLOCK), -(-shape[1] // BLOCK))
    rows, columns = np.divmod(np.arange(patches), shape[1])
    block = rows // BLOCK * blocks[1] + columns // BLOCK
    weight = 1 / np.mean(sigma**2, axis=1)

    of_block = block[index]
    block_middle = _means(of_block, camera_px, blocks[0] * blocks[1])
    u, v = (camera_px - block_middle[of_block]).T
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    bend, _ = _grouped_fit(of_block, terms, xy, weight, len(block_middle))
    count = np.bincount(index, minlength=patches).astype(float)
    filled = np.bincount(block, count >= FEWEST_PIXELS, len(block_middle))
    bend[filled < FULL_BLOCK] = 0.0  # a corner of a block does not tell how it bends
    fits = _Fits(
        _means(index, camera_px, patches),
        np.zeros((patches, 3, 2)),
        np.zeros((patches, 3, 3)),
        block,
        block_middle,
        bend[:, 3:],
        count,
        _means(index, shared**2, patches).mean(axis=1),
    )
    near = camera_px - fits.middle[index]
    terms = np.concatenate([np.ones((len(near), 1)), near], axis=1)
    straight = xy - fits.bent(index, camera_px)
    fits.line[:], fits.inverse[:] = _grouped_fit(index, terms, straight, weight, patches)
    return fits


def _together(index: Index, camera_px: Array, shape: tuple[int, int]) -> Mask:
    """Which pixels (N,) lie where most of their patch does: misread ones would pull it far."""
    patches = shape[0] * shape[1]
    use = np.ones(len(index), bool)
    for _ in range(ROUNDS):
        away = camera_px - _means(index[use], camera_px[use], patches)[index]
        away = np.sum(away**2, axis=1, keepdims=True)
        use = away[:, 0] <= FAR**2 * _means(index[use], away[use], patches)[index, 0]
    return use


def _means(index: Index, values: Array, groups: int) -> Array:
    count = np.maximum(np.bincount(index, minlength=groups), 1)
    return np.stack([np.bincount(index, column, groups) / count for column in values.T], axis=1)


def _grouped_fit(
    index: Index, terms: Array, values: Array, weight: Array, groups: int
) -> tuple[Array, Array]:
    """Weighted least squares of values (N, 2) on terms (N, T) in each group: (G, T, 2), (G, T, T)."""
    count = terms.shape[1]
    normal, right = np.empty((groups, count, count)), np.empty((groups, count, 2))
    for i in range(count):
        weighted = weight * terms[:, i]
        for j in range(i, count):
            normal[:, i, j] = normal[:, j, i] = np.bincount(index, weighted * terms[:, j], groups)
        for j in range(2):
            right[:, i, j] = np.bincount(index, weighted * values[:, j], groups)
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    unit = normal / scale[:, :, None] / scale[:, None, :] + 1e-9 * np.eye(count)
    inverse = np.linalg.inv(unit) / scale[:, :, None] / scale[:, None, :]
    return inverse @ right, inverse


def _at_centres(fits: _Fits, patch_px: int, shape: tuple[int, int]) -> ProjectorMap:
    rows, columns = np.indices(shape)
    centre = (np.stack([columns, rows], -1).reshape(-1, 2) + 0.5) * patch_px - 0.5
    every = np.arange(len(centre))
    slope = fits.slope(every, fits.middle)
    size = np.abs(np.linalg.det(slope))  # projector px^2 that one camera pixel covers
    valid = (fits.count >= FEWEST_PIXELS) & (size > 1e-6)
    slope = np.where(valid[:, None, None], slope, np.eye(2))
    place = fits.middle
    for _ in range(2):  # Newton's method; the second step takes the little curvature there is
        ahead = centre - fits.predict(every, place)
        place = place + np.linalg.solve(slope, ahead[..., None])[..., 0]
    step = place - fits.middle
    reach = np.abs(np.einsum("nij,nj->ni", slope, step))
    valid &= (reach <= INSIDE * patch_px).all(axis=1)
    terms = np.concatenate([np.ones((len(step), 1)), step], axis=1)
    variance = np.einsum("ni,nij,nj->n", terms, fits.inverse, terms)
    return _masked(fits, patch_px, shape, place, slope, variance, valid)


def _masked(
    fits: _Fits,
    patch_px: int,
    shape: tuple[int, int],
    place: Array,
    slope: Array,
    variance: Array,
    valid: NDArray[np.bool_],
) -> ProjectorMap:
    def grid(values: Array) -> NDArray[np.float32]:
        masked = np.where(valid.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)
        return masked.reshape(*shape, *values.shape[1:]).astype(np.float32)

    coverage = np.where(valid, fits.count * np.abs(np.linalg.det(slope)), 0) / patch_px**2
    return ProjectorMap(
        patch_px,
        grid(place),
        grid(np.sqrt(variance + SHARED_PX**2 + fits.shared_px2)),
        grid(slope),
        coverage.reshape(shape).astype(np.float32),
        fits.count.reshape(shape).astype(np.int32),
        valid.reshape(shape),
    )
