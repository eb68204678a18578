"""Image operations by OpenCV: sampling at fractional positions, blur, masks, block means."""

import cv2
import numpy as np

from procam.arrays import Array, BoolArray, FloatArray, Image

EXACT_CHANNELS = (1, 3, 4)
JUMP = 3.0  # of the areas around it: larger is the distance between two surfaces


def sample(image: FloatArray, xy: FloatArray, outside: float = 0.0) -> Image:
    """Bilinear samples (..., C) of `image` (H, W[, C]) at pixel coordinates `xy` (..., 2).

    Positions outside the image, and NaN, give `outside`. OpenCV 5 is exact to 3e-5 px with float maps
    and 1, 3 or 4 channels. Other numbers of channels it rounds to 1/32 px, so they are sampled one by
    one. No side may exceed 32766 px.
    """
    if image.ndim == 3 and image.shape[2] not in EXACT_CHANNELS:
        planes = [sample(image[..., i], xy, outside) for i in range(image.shape[2])]
        return np.stack(planes, axis=-1)
    image = np.ascontiguousarray(image, np.float32)
    with np.errstate(over="ignore"):  # far outside is outside
        where = np.nan_to_num(np.asarray(xy, np.float32), nan=-1e6, posinf=-1e6, neginf=-1e6)
    where = where.reshape(xy.shape[0], -1, 2)
    channels = image.shape[2] if image.ndim == 3 else 0
    sampled = cv2.remap(  # type: ignore[call-overload]
        image,
        np.ascontiguousarray(where),
        None,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(outside,) * 4,
    )
    tail = (channels,) if channels else ()
    return np.asarray(sampled, np.float32).reshape(*xy.shape[:-1], *tail)


def blur(image: FloatArray, sigma_px: float) -> Image:
    """Gaussian blur of (H, W[, C]); the border is mirrored."""
    source = np.ascontiguousarray(image, np.float32)
    return np.asarray(cv2.GaussianBlur(source, (0, 0), sigma_px), np.float32).reshape(image.shape)


def blur_in_dark(image: FloatArray, sigma_px: float) -> Image:
    """Gaussian blur of (H, W[, C]), beyond which all is 0."""
    source = np.ascontiguousarray(image, np.float32)
    soft = cv2.GaussianBlur(source, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(soft, np.float32).reshape(image.shape)


def affine_inliers(start: Array, end: Array, within: float) -> BoolArray:
    """Which points (n,) one affine motion, by RANSAC, moves from `start` (n, 2) to `within` of `end` (n, 2).

    None of them if all lie on a line.
    """
    _, inside = cv2.estimateAffine2D(start, end, None, cv2.RANSAC, within)
    return np.asarray(np.ravel(inside) > 0)


def enlarged(image: FloatArray, shape: tuple[int, int]) -> Image:
    """An image (h, w[, C]) interpolated to `shape` (H, W)."""
    source = np.ascontiguousarray(image, np.float32)
    return np.asarray(cv2.resize(source, shape[::-1]), np.float32).reshape(*shape, *image.shape[2:])


def filter_in_dark(image: FloatArray, kernel: FloatArray) -> Image:
    """A symmetric kernel (K,) along rows and columns of (H, W), beyond which all is 0."""
    source = np.ascontiguousarray(image, np.float32)
    found = cv2.sepFilter2D(source, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(found, np.float32)


def window_mean(image: FloatArray, size_px: int) -> Image:
    """Mean of (H, W) over a square window about each pixel; the border is mirrored."""
    source = np.ascontiguousarray(image, np.float32)
    return np.asarray(cv2.blur(source, (size_px, size_px)), np.float32)


def reduced_to(image: FloatArray, shape: tuple[int, int]) -> Image:
    """Means (h, w[, C]) of an image (H, W[, C]) over the pixels of a smaller `shape`."""
    source = np.ascontiguousarray(image, np.float32)
    small = cv2.resize(source, shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32).reshape(*shape, *image.shape[2:])


def blur_within(image: FloatArray, mask: BoolArray, sigma_px: float) -> Image:
    """Gaussian blur of (H, W[, C]) over the pixels of `mask` (H, W) alone, which also fills just outside.

    Pixels out of reach of the mask become 0.
    """
    weight = blur(mask.astype(np.float32), sigma_px)
    shaped = (..., None) if image.ndim == 3 else (...,)
    total = blur(np.where(mask[shaped], image, np.float32(0)), sigma_px)
    reached = weight > 1e-4
    total /= np.maximum(weight, 1e-4)[shaped]
    total[~reached] = 0
    return total


def grow(mask: BoolArray, pixels: int) -> BoolArray:
    """`mask` (H, W) dilated by a disc of radius `pixels`; a negative radius erodes it."""
    size = 2 * abs(pixels) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    change = cv2.dilate if pixels > 0 else cv2.erode
    changed = change(mask.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(changed, bool)


def edge_distance(mask: BoolArray) -> Image:
    """Distance (H, W) [px] of each pixel of `mask` to the nearest one outside; the border is outside."""
    padded = np.pad(mask.astype(np.uint8), 1)
    distance = cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_5)
    return np.asarray(distance[1:-1, 1:-1], np.float32)


def block_mean(image: FloatArray, size: int) -> Image:
    """Means over `size` x `size` blocks of (H, W[, C]); an incomplete block at the edge is left out."""
    height, width = (n // size * size for n in image.shape[:2])
    trimmed = np.ascontiguousarray(image[:height, :width], np.float32)
    target = (width // size, height // size)
    shrunk = cv2.resize(trimmed, target, interpolation=cv2.INTER_AREA)
    return np.asarray(shrunk, np.float32).reshape(target[1], target[0], *image.shape[2:])


def local_median(image: FloatArray, mask: BoolArray) -> Image:
    """Median over the pixels of `mask` in 5 x 5 neighbourhoods of (H, W).

    Other pixels count as very large or very small in turn, which shifts it by one rank at most.
    """
    checkers = np.add.outer(np.arange(mask.shape[0]), np.arange(mask.shape[1])) % 2
    sides = np.where(checkers, np.float32(1e9), np.float32(-1e9))
    filled = np.where(mask, image, sides).astype(np.float32)
    return np.asarray(cv2.medianBlur(filled, 5), np.float32)


def without_jumps(area: FloatArray, mask: BoolArray) -> Array:
    """Areas (H, W) of a picture's pixels on a surface: the median around for those in which it jumps."""
    around = local_median(area, mask)
    return np.where(mask & (area > JUMP * around), around, area).astype(float)


def pixel_places(shape: tuple[int, ...], other: tuple[int, ...]) -> Array:
    """Places (H, W, 2) as (column, row) [px], in a picture of another shape, of the pixels of one of a shape.

    Both show the same; places beside the outermost pixels' centres are moved to these.
    """
    rows, columns = shape[:2]
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    share = np.stack([(x + 0.5) / columns, (y + 0.5) / rows], axis=-1)
    last = np.array(other[1::-1])
    return np.asarray(np.clip(share * last - 0.5, 0, last - 1))
