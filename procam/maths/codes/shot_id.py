"""Shot marks: ids drawn into patterns and read back from photographs of them.

A pattern carries its shot id at five places, each time as an AprilTag (Olson, ICRA 2011, doi
10.1109/ICRA.2011.5979561) with the id in digits below. Any two tags of the family 36h11 differ in 11
bits or more, so a tag is either read right or not at all. One tag in full view is enough. To read
one, the photograph is rendered in 8 bits in several ways, the fastest first, until OpenCV finds a tag.
"""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from procam.arrays import AnyArray, BoolArray, Image
from procam.errors import InputError
from procam.maths.codes.april_tags import find_tags, tag_cells

Picture = NDArray[np.uint8]
FAMILY, SHOT_ID_COUNT = "36h11", 587  # tags in the family
TAG_CELLS, QUIET_CELLS, DIGIT_CELLS = 8, 1, 3
CENTRES = (
    (0.5, 0.5),
    (0.2, 0.2),
    (0.8, 0.2),
    (0.2, 0.8),
    (0.8, 0.8),
)  # of the blocks, on the panel
CELLS_PER_PANEL = 130  # along its shorter side: the smallest that a camera of as many pixels reads
CELLS_PER_MASTER = 360  # along a dome master, which a camera sees whole: half a degree each
SMALLEST_CELL_PX = 3
SMALLEST_PANEL = (120, 80)
DIGITS = (
    "111101101101111 010110010010111 111001111100111 111001111001111 101101111001001",
    "111100111001111 111100111101111 111001001001001 111101111101111 111101111001111",
)
LARGE_PHOTO_PX = 2400  # a larger photograph is reduced first, which is faster and averages noise
SMALLEST_TAG_PX = 12.0  # edge, in the photograph
SHARPEN, SHARPEN_PX = 2.0, 2.5
DENOISE_PX = 0.7


def shot_id_blocks(
    size: tuple[int, int], cells: int = CELLS_PER_PANEL
) -> list[tuple[int, int, int, int]]:
    """Rectangles (x, y, width, height) [px] that the marks cover on a panel of `size`.

    The shorter side of the panel has the length of `cells` cells of a tag.

    >>> shot_id_blocks((1280, 800))[0]
    (610, 361, 60, 78)
    """
    if size[0] < SMALLEST_PANEL[0] or size[1] < SMALLEST_PANEL[1]:
        raise InputError(
            f"panel: {size[0]}x{size[1]} px is too small for readable shot marks; it must have at least "
            f"{SMALLEST_PANEL[0]}x{SMALLEST_PANEL[1]} px"
        )
    cell = _cell_px(size, cells)
    width = (TAG_CELLS + 2 * QUIET_CELLS) * cell
    height = width + DIGIT_CELLS * cell
    return [
        (
            int(np.clip(round(x * size[0] - width / 2), 0, size[0] - width)),
            int(np.clip(round(y * size[1] - height / 2), 0, size[1] - height)),
            width,
            height,
        )
        for x, y in CENTRES
    ]


def shot_id_pixels(size: tuple[int, int], cells: int = CELLS_PER_PANEL) -> BoolArray:
    """Panel pixels (H, W) that the marks cover, which do not show the pattern."""
    taken = np.zeros((size[1], size[0]), bool)
    for x, y, width, height in shot_id_blocks(size, cells):
        taken[y : y + height, x : x + width] = True
    return taken


def draw_shot_id(
    picture: Picture, number: int, drive: int | None = None, cells: int = CELLS_PER_PANEL
) -> Picture:
    """A copy of `picture` (H, W, C) with the mark of shot `number` in it.

    Parameters
    ----------
    drive : 0..255, of the bright parts of the marks. By default they have the largest drive of each
        channel, so that a red picture stays red; a black picture needs another.
    cells : cells of a tag along the picture's shorter side.

    Raises
    ------
    InputError : no tag has this number, or the picture is too small.
    """
    if not 0 <= number < SHOT_ID_COUNT:
        raise InputError(
            f"shot id: {number} is not in 0..{SHOT_ID_COUNT - 1}, and there are no more marks; "
            "capture the projectors in two groups"
        )
    height, width = picture.shape[:2]
    bright = picture.max(axis=(0, 1)) if drive is None else np.full(picture.shape[2], drive)
    drawn = picture.copy()
    block = _block(number, _cell_px((width, height), cells))
    for x, y, across, down in shot_id_blocks((width, height), cells):
        drawn[y : y + down, x : x + across] = np.where(block[..., None], bright, 0)
    return drawn


def read_shot_id(photo: AnyArray) -> int | None:
    """The shot id in a photograph (H, W) or (H, W, C) of any linear unit; None if none is readable.

    Tags that contradict each other, as in an exposure of two patterns, count as unreadable.
    """
    grey = np.asarray(photo, np.float32)
    grey = grey.mean(axis=2) if grey.ndim == 3 else grey
    for picture in _versions(grey):
        found = {n for n, _ in find_tags(picture, FAMILY, least_px=SMALLEST_TAG_PX)}
        if found:
            return found.pop() if len(found) == 1 else None
    return None


def _cell_px(size: tuple[int, int], cells: int) -> int:
    return max(SMALLEST_CELL_PX, round(min(size) / cells))


def _block(number: int, cell: int) -> BoolArray:
    """Bright pixels of a block: the tag, its quiet zone and the digits below."""
    tag = tag_cells(FAMILY, number)
    block = np.pad(np.kron(tag, np.ones((cell, cell), bool)), cell, constant_values=True)
    below = np.ones((DIGIT_CELLS * cell, block.shape[1]), bool)
    dot = cell // 2
    line = np.concatenate([_digit(int(figure)) for figure in f"{number:04d}"], axis=1)
    drawn = np.kron(line, np.ones((dot, dot), bool))
    below[: drawn.shape[0], cell : cell + drawn.shape[1]] = ~drawn
    return np.concatenate([block, below])


def _digit(figure: int) -> BoolArray:
    """Dark dots (5, 4) of a figure; the last column separates it from the next."""
    dots = " ".join(DIGITS).split()[figure]
    return np.pad(np.array([d == "1" for d in dots]).reshape(5, 3), ((0, 0), (0, 1)))


def _versions(grey: Image) -> Iterator[Picture]:
    """8-bit renderings of a photograph, the fastest first."""
    shrink = -(-max(grey.shape) // LARGE_PHOTO_PX)
    if shrink > 1:
        small = (grey.shape[1] // shrink, grey.shape[0] // shrink)
        yield _rendered(np.asarray(cv2.resize(grey, small, interpolation=cv2.INTER_AREA)), 1.0)
    yield _rendered(grey, 1.0)
    if shrink == 1:
        larger = (2 * grey.shape[1], 2 * grey.shape[0])
        yield _rendered(np.asarray(cv2.resize(grey, larger, interpolation=cv2.INTER_CUBIC)), 1.0)
    yield _rendered(grey, 0.5)  # for dim tags beside a bright lamp


def _rendered(grey: Image, exponent: float) -> Picture:
    """Stretched and sharpened; in linear light a blurred edge does not move."""
    smooth = cv2.GaussianBlur(grey, (0, 0), DENOISE_PX)
    low, high = np.percentile(smooth[::3, ::3], [1, 99.8])
    tone = np.clip((smooth - low) / max(float(high - low), 1e-9), 0, 1) ** exponent
    tone += SHARPEN * (tone - cv2.GaussianBlur(tone, (0, 0), SHARPEN_PX))
    return np.asarray(255 * np.clip(tone, 0, 1), np.uint8)
