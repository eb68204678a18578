"""Camera pixel at which each patch of a projector's panel is seen, from a correspondence map.

The panel is divided into square patches with some 72 camera pixels each. In each patch a straight line
of projector coordinates on camera pixels is fitted, with the curvature of a block of patches; the
camera pixel of the patch's centre follows by inverting the fit. The camera pixels have exact positions
and the projector coordinates have noise, so the fit is in this direction. `drop_inconsistent` uses the
fits to find misread pixels.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procam.arrays import Array, Array32, BoolArray, FloatArray, IndexArray
from procam.estimate.structured_light.outliers import keep_only
from procam.maths.grouped_fit import NormalEquations
from procam.model.correspondence import CorrespondenceMap, ProjectorMap

PIXELS_PER_PATCH = 72  # reduce a noise of 0.3 px to 0.04
SMALLEST_PATCH_PX = 4
MIN_PIXELS = 12
BLOCK = 4  # patches along the edge of a block, over which the curvature is constant
FULL_BLOCK = BLOCK**2 / 2  # patches of it that must be seen
INSIDE = 0.2  # of the patch: largest distance of its centre from the mean of its pixels
FAR = 3.0  # standard deviations of a patch from its mean; a parallelogram reaches 2.45 at most
SIGMAS = 6.0
SHARED_PX = 0.0025  # least error that neighbouring pixels have in common (studies/codes.md)
MISFIT_PX = 0.5  # residual that the fit may have beyond noise
ROUNDS = 2
PART = 1 << 18  # pixels at a time


@dataclass(frozen=True, slots=True)
class _Pixels:
    """The decoded camera pixels: camera_px, xy, their standard errors sigma and shared, (N, 2) [px] each.

    In single precision, and in double precision a part at a time: a large camera has ten million.
    """

    camera_px: Array32
    xy: Array32
    sigma: Array32
    shared: Array32

    def parts(self) -> Iterator[slice]:
        """Slices of the pixels, one after the other."""
        return (slice(i, i + PART) for i in range(0, len(self.xy), PART))

    def some(self, part: slice, use: BoolArray) -> "_Pixels":
        """The pixels of a part that `use` (N,) selects, in double precision."""
        of, chosen = (self.camera_px, self.xy, self.sigma, self.shared), use[part]
        return _Pixels(*(values[part][chosen].astype(float) for values in of))


@dataclass(frozen=True, slots=True)
class _Bends:
    """Curvature of the map in each of B blocks of patches.

    Attributes
    ----------
    block : (P,) of each patch. middle : (B, 2) mean camera pixel.
    terms : (B, 3, 2) factors of u^2, u v and v^2, where (u, v) = camera pixel - middle.
    """

    block: IndexArray
    middle: Array
    terms: Array

    def at(self, patch: IndexArray, camera_px: FloatArray) -> Array:
        """The quadratic part (N, 2) [projector px] of the map."""
        u, v, terms = self.local(patch, camera_px)
        return u * u * terms[:, 0] + u * v * terms[:, 1] + v * v * terms[:, 2]

    def local(self, patch: IndexArray, camera_px: FloatArray) -> tuple[Array, Array, Array]:
        """Offsets u and v (N, 1) of camera pixels (N, 2), and the terms (N, 3, 2) of their blocks."""
        block = self.block[patch]
        u, v = (camera_px - self.middle[block]).T[..., None]
        return u, v, self.terms[block]


@dataclass(frozen=True, slots=True)
class _Fits:
    """Projector = bends(camera) + line (1, camera - middle) in each of P patches.

    Attributes
    ----------
    middle : (P, 2) mean camera pixel. line : (P, 3, 2). inverse : (P, 3, 3) of its normal matrix.
    count : (P,) camera pixels. shared_px2 : (P,) variance that the pixels of a patch have in common.
    """

    middle: Array
    line: Array
    inverse: Array
    bends: _Bends
    count: Array
    shared_px2: Array

    def predict(self, patch: IndexArray, camera_px: FloatArray) -> Array:
        """Projector pixel (N, 2) of camera pixels (N, 2), by their `patch` (N,)."""
        near = camera_px - self.middle[patch]
        lines = self.line[patch]
        straight = lines[:, 0] + near[:, :1] * lines[:, 1] + near[:, 1:] * lines[:, 2]
        return straight + self.bends.at(patch, camera_px)

    def slope(self, patch: IndexArray, camera_px: Array) -> Array:
        """Projector pixels per camera pixel (N, 2, 2) at camera pixels (N, 2)."""
        u, v, terms = self.bends.local(patch, camera_px)
        line = self.line[patch]
        across = line[:, 1] + 2 * u * terms[:, 0] + v * terms[:, 1]
        down = line[:, 2] + u * terms[:, 1] + 2 * v * terms[:, 2]
        return np.stack([across, down], axis=-1)


def fit_projector_map(found: CorrespondenceMap, size: tuple[int, int]) -> ProjectorMap:
    """The camera pixel at which the centre of each patch of a panel of `size` (width, height) is seen.

    The fit is made twice, because noise moves pixels over the borders between patches.
    """
    pixels = _pixels(found)
    patch_px = patch_size(pixels.xy)
    shape = (-(-size[1] // patch_px), -(-size[0] // patch_px))
    index = _patch_index(pixels.xy, patch_px, shape)
    use = _near_their_patch(index, pixels, shape)
    for _ in range(ROUNDS):
        fits = _fit(index, pixels, use, shape)
        for part in pixels.parts():
            xy, patch = pixels.xy[part], index[part]
            position = fits.predict(patch, pixels.camera_px[part])
            near = np.abs(xy - position) <= MISFIT_PX + SIGMAS * pixels.sigma[part]
            use[part] = near.all(axis=1) & (fits.count[patch] >= MIN_PIXELS)
            position = np.where(use[part, None], position, xy)
            index[part] = _patch_index(position, patch_px, shape)
    return _at_centres(fits, patch_px, shape)


def patch_size(xy: FloatArray) -> int:
    """Edge [px] of patches that contain some 72 of the projector coordinates xy (N, 2)."""
    if not len(xy):
        return SMALLEST_PATCH_PX
    column, row = np.floor(xy / 16).astype(np.int32).T
    cells = np.unique(column + (row << 14), return_counts=True)
    density = float(np.median(cells[1])) / 16**2
    return max(SMALLEST_PATCH_PX, round(float(np.sqrt(PIXELS_PER_PATCH / density))))


def drop_inconsistent(found: CorrespondenceMap, seen: ProjectorMap) -> CorrespondenceMap:
    """Drop camera pixels that contradict the fit of the patch they are decoded to: they are misread.

    Pixels of patches without a fit are kept.
    """
    pixels, (height, width) = _pixels(found), seen.valid.shape
    ok = np.empty(len(pixels.xy), bool)
    for part in pixels.parts():
        xy = pixels.xy[part].astype(float)
        patch = np.clip((xy + 0.5) / seen.patch_px, 0, [width - 1e-3, height - 1e-3]).astype(int)
        at = (patch[:, 1], patch[:, 0])
        offset = pixels.camera_px[part] - seen.camera_px[at]
        centre = (patch + 0.5) * seen.patch_px - 0.5
        miss = np.abs(xy - centre - np.einsum("nij,nj->ni", seen.slope[at], offset))
        near = (miss <= MISFIT_PX + SIGMAS * pixels.sigma[part]).all(axis=1)
        ok[part] = near | ~seen.valid[at]
    keep = np.zeros_like(found.valid)
    keep[found.valid] = ok
    return keep_only(found, keep)


def _patch_index(position: FloatArray, patch_px: int, shape: tuple[int, int]) -> IndexArray:
    cell = np.floor((position + 0.5) / patch_px).astype(np.int32)
    column, row = np.clip(cell, 0, [shape[1] - 1, shape[0] - 1]).T
    return np.asarray(row * shape[1] + column, np.int32)


def _pixels(found: CorrespondenceMap) -> _Pixels:
    camera_px = np.argwhere(found.valid)[:, ::-1].astype(np.float32)
    xy = found.projector_xy[found.valid]
    sigma = np.maximum(found.sigma_px[found.valid], np.float32(1e-6))
    shared = found.shared_px
    errors = np.zeros_like(xy) if shared is None else shared[found.valid]
    return _Pixels(camera_px, xy, sigma, errors)


def _fit(index: IndexArray, pixels: _Pixels, use: BoolArray, shape: tuple[int, int]) -> _Fits:
    patches = shape[0] * shape[1]
    count = np.bincount(index[use], minlength=patches).astype(float)
    bends = _fit_bends(index, pixels, use, count >= MIN_PIXELS, shape)
    middle = _means(index, pixels.camera_px, use, patches)
    normal = NormalEquations(3, patches)
    for part in pixels.parts():
        some, patch = pixels.some(part, use), index[part][use[part]]
        near = some.camera_px - middle[patch]
        straight = some.xy - bends.at(patch, some.camera_px)
        normal.add(patch, [np.ones(len(near)), *near.T], straight, _weight(some))
    shared_px2 = _means(index, pixels.shared**2, use, patches).mean(axis=1)
    return _Fits(middle, *normal.solved(), bends, count, shared_px2)


def _fit_bends(
    index: IndexArray,
    pixels: _Pixels,
    use: BoolArray,
    seen: BoolArray,
    shape: tuple[int, int],
) -> _Bends:
    """Curvature of the blocks of which at least half the patches are `seen` (P,), 0 for the others."""
    blocks = (-(-shape[0] // BLOCK), -(-shape[1] // BLOCK))
    rows, columns = np.divmod(np.arange(len(seen)), shape[1])
    block = (rows // BLOCK * blocks[1] + columns // BLOCK).astype(np.int32)
    middle = _means(block[index], pixels.camera_px, use, blocks[0] * blocks[1])
    normal = NormalEquations(6, len(middle))
    for part in pixels.parts():
        some, of_pixel = pixels.some(part, use), block[index[part][use[part]]]
        u, v = (some.camera_px - middle[of_pixel]).T
        terms = [np.ones_like(u), u, v, u * u, u * v, v * v]
        normal.add(of_pixel, terms, some.xy, _weight(some))
    bend, _ = normal.solved()
    bend[np.bincount(block, seen, len(middle)) < FULL_BLOCK] = 0.0
    return _Bends(block, middle, bend[:, 3:])


def _weight(pixels: _Pixels) -> Array:
    return np.asarray(1 / np.mean(pixels.sigma**2, axis=1))


def _near_their_patch(index: IndexArray, pixels: _Pixels, shape: tuple[int, int]) -> BoolArray:
    """Pixels (N,) that lie near the mean camera pixel of their patch; misread ones do not."""
    patches = shape[0] * shape[1]
    use = np.ones(len(index), bool)
    away = np.empty((len(index), 1), np.float32)
    for _ in range(ROUNDS):
        middle = _means(index, pixels.camera_px, use, patches)
        for part in pixels.parts():
            step = pixels.camera_px[part] - middle[index[part]]
            away[part] = np.sum(step**2, axis=1, keepdims=True)
        use = away[:, 0] <= FAR**2 * _means(index, away, use, patches)[index, 0]
    return use


def _means(index: IndexArray, values: FloatArray, use: BoolArray, groups: int) -> Array:
    """Means (G, C) of the values (N, C) of each group that `use` (N,) selects."""
    chosen = index[use]
    count = np.maximum(np.bincount(chosen, minlength=groups), 1)
    return np.stack([np.bincount(chosen, v[use], groups) / count for v in values.T], axis=1)


def _at_centres(fits: _Fits, patch_px: int, shape: tuple[int, int]) -> ProjectorMap:
    rows, columns = np.indices(shape)
    centre = (np.stack([columns, rows], -1).reshape(-1, 2) + 0.5) * patch_px - 0.5
    every = np.arange(len(centre))
    slope = fits.slope(every, fits.middle)
    size = np.abs(np.linalg.det(slope))  # projector px^2 that one camera pixel covers
    valid = (fits.count >= MIN_PIXELS) & (size > 1e-6)
    slope = np.where(valid[:, None, None], slope, np.eye(2))
    position = fits.middle
    for _ in range(2):  # Newton's method; the second step accounts for the curvature
        ahead = centre - fits.predict(every, position)
        position = position + np.linalg.solve(slope, ahead[..., None])[..., 0]
    step = position - fits.middle
    reach = np.abs(np.einsum("nij,nj->ni", slope, step))
    valid &= (reach <= INSIDE * patch_px).all(axis=1)
    terms = np.concatenate([np.ones((len(step), 1)), step], axis=1)
    variance = np.einsum("ni,nij,nj->n", terms, fits.inverse, terms)
    return _masked(fits, patch_px, shape, position, slope, variance, valid)


def _masked(
    fits: _Fits,
    patch_px: int,
    shape: tuple[int, int],
    position: Array,
    slope: Array,
    variance: Array,
    valid: BoolArray,
) -> ProjectorMap:
    def grid(values: Array) -> Array32:
        masked = np.where(valid.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)
        return masked.reshape(*shape, *values.shape[1:]).astype(np.float32)

    coverage = np.where(valid, fits.count * np.abs(np.linalg.det(slope)), 0) / patch_px**2
    return ProjectorMap(
        patch_px,
        grid(position),
        grid(np.sqrt(variance + SHARED_PX**2 + fits.shared_px2)),
        grid(slope),
        coverage.reshape(shape).astype(np.float32),
        fits.count.reshape(shape).astype(np.int32),
        valid.reshape(shape),
    )
